"""PPO of either library as a run of `train` uses it, and its settings, the same for both as far as both have them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, ClassVar, Protocol

import numpy as np
from gymnasium.vector import VectorEnv

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import MissingPackageError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.network import Float32Array, Network

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


class EndedError(Exception):
    """The run is to end after this update."""


class Actor(Protocol):
    """The part of a model that is exported."""

    def network(self) -> Network:
        """Return the network as it is exported.

        Raises:
            InputError: it is not made of linear layers.
        """

    def answer(self, observations: Float32Array) -> Float32Array:
        """Return raw actions (k, m) for observations (k, N), as the library computes them."""


class Learner(ABC):
    """PPO of one library, around environments that it closes."""

    SUFFIX: ClassVar[str]
    """File name suffix of its checkpoints."""
    model: Any
    """The library's own."""
    envs: Any
    """The environments, as the library takes them."""
    actor: Actor
    steps: int
    """Policy steps of all robots so far."""

    @abstractmethod
    def __init__(
        self, envs: VectorEnv[Any, Any, Any], settings: PPOSettings, spread: float, seed: int, start: Path | None
    ) -> None:
        """Begin, or go on.

        Args:
            envs: that start episodes in the step that ends the last ones.
            settings: of PPO.
            spread: standard deviation of the raw actions of a new network.
            seed: of networks, actions and environments.
            start: a checkpoint to go on from.
        """

    @abstractmethod
    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """Train until so many policy steps are done; `after_update` returns whether to go on."""

    @abstractmethod
    def save(self, file: IO[bytes]) -> None:
        """Write a checkpoint, between two updates."""


def learner_class(algorithm: str) -> type[Learner]:
    """Return the learner of an algorithm's name.

    Raises:
        MissingPackageError: its library is not installed.
    """
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
