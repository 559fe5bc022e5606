"""PPO of either library as a run of `train` uses it, and its settings, the same for both as far as both have them."""

from __future__ import annotations

import contextlib
import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np
import numpy.typing as npt
from gymnasium.vector import VectorEnv

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.training.ppo.journal import Update

Float32Array = npt.NDArray[np.float32]

ALGORITHMS = ("ppo-sb3", "ppo-rsl_rl")

_FIRST_SPREAD = {False: 0.2, True: 0.1}
"""rad by which a new network moves its joints at random, by whether the base is floating: enough to learn from (with
half of it the arms learn a quarter as fast to track), and little enough to stay up for a while."""


@dataclass(frozen=True)
class PPOSettings:
    """One PPO."""

    widths: tuple[int, ...] = (256, 128)
    """Widths of the hidden layers, of actor and critic each; ELU between them."""
    steps_per_update: int = 32
    """Policy steps of each robot."""
    epochs: int = 5
    minibatches: int = 4
    learning_rate: float = 5e-4
    """rsl_rl adapts it to `desired_kl`."""
    least_deviation: float = 0.2
    """Added to the observations' standard deviations, which normalise them: what hardly ever changed is not blown up
    when it does. Observations are of order one as they are."""
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.001
    value: float = 1.0
    largest_gradient: float = 1.0
    desired_kl: float = 0.02
    """Kullback-Leibler divergence of an update; at three times as much stable-baselines3 ends it early."""


SETTINGS = PPOSettings()


def first_spread(contract: PolicyContract, *, is_floating: bool) -> float:
    """Return the standard deviation of the raw actions of a new network."""
    return float(_FIRST_SPREAD[is_floating] / np.median(np.abs(contract.action_scale)))


@dataclass(frozen=True, slots=True)
class Actor:
    """The part of a model that is exported."""

    network: Any
    """Module of PyTorch, from observations (k, N) as the environment has them to raw actions (k, m)."""
    widths: tuple[int, int]
    """N and m."""
    answer: Callable[[Float32Array], Float32Array]
    """Raw actions for observations, as the library computes them: the network and its export must agree with it."""


class Learner(ABC):
    """PPO of one library, around environments that it closes."""

    SUFFIX: ClassVar[str]
    """File name suffix of its checkpoints."""
    model: Any
    """The library's own."""
    envs: Any
    """The environments, as the library takes them."""
    answer: Callable[[Float32Array], Float32Array]
    """See `Actor.answer`; of the network as it is by then."""
    steps: int
    """Policy steps of all robots so far."""

    @abstractmethod
    def __init__(self, envs: VectorEnv[Any, Any, Any], spread: float, seed: int, start: Path | None) -> None:
        """Begin, or go on from the checkpoint `start`.

        The environments start episodes in the step that ends the last ones; `spread` is the standard deviation of the
        raw actions of a new network; the seed is that of networks, actions and environments.
        """

    @abstractmethod
    def update(self) -> Update:
        """Let the robots act for a while, and update the networks by it once."""

    @abstractmethod
    def save(self, file: IO[bytes]) -> None:
        """Write a checkpoint, between two updates."""


@contextlib.contextmanager
def reading(checkpoint: Path) -> Iterator[None]:
    """Make one line of whatever a library says of a file that is damaged, or holds more than arrays and numbers."""
    try:
        yield
    except Exception as error:
        raise InputError(
            f"--resume: '{checkpoint}' is damaged, or holds more than arrays and numbers, which is not run: "
            f"{type(error).__name__}"
        ) from None


def require_sound(optimiser: Any, *networks: Any) -> None:
    """Try one step of what was read, on a copy: what would fail in an update only is found here.

    Raises whatever PyTorch makes of a state that does not fit, and a `ValueError` for numbers that are not finite.
    """
    trial = copy.deepcopy(optimiser)
    tried = [weights for group in trial.param_groups for weights in group["params"]]
    for weights in tried:
        weights.grad = weights.detach() * 0.0
    trial.step()
    read = [value for network in networks for value in network.state_dict().values()]
    if not all(bool(value.isfinite().all()) for value in (*read, *tried)):
        raise ValueError("is not finite")


def learner_class(algorithm: str) -> type[Learner]:
    """Return the learner of an algorithm's name. Raises `MissingPackageError` if its library is not installed."""
    try:
        if algorithm == "ppo-sb3":
            from humanoid_sim.training.ppo.sb3 import StableBaselinesLearner  # noqa: PLC0415 - one of them is enough

            return StableBaselinesLearner
        from humanoid_sim.training.ppo.rsl import RslRlLearner  # noqa: PLC0415

        return RslRlLearner
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        if package not in ("torch", "stable_baselines3", "rsl_rl", "tensordict"):
            raise
        raise MissingPackageError(package, "rl", "training train") from None
