"""What both libraries' PPO are to a run of `train`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from gymnasium.vector import VectorEnv

from humanoid_sim.errors import MissingPackageError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.network import Float32Array
from humanoid_sim.training.ppo.settings import PPOSettings

__all__ = ["ALGORITHMS", "Learner", "learner_class"]

ALGORITHMS = ("ppo-sb3", "ppo-rsl_rl")


class Learner(Protocol):
    """PPO of one library, around environments that it closes."""

    SUFFIX: str
    """Of its checkpoints."""
    model: Any
    """The library's own."""
    envs: Any
    """The environments, as the library takes them."""

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

    @property
    def steps(self) -> int:
        """Policy steps of all robots so far."""

    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """Train until so many policy steps are done; `after_update` returns whether to go on."""

    def save(self, path: Path) -> None:
        """Write a checkpoint, between two updates."""

    def answer(self, observations: Float32Array) -> Float32Array:
        """The actor's raw actions (k, m) for observations (k, N), as the library computes them."""

    def close(self) -> None:
        """Close the environments."""


def learner_class(algorithm: str) -> type[Learner]:
    """The learner of an algorithm's name.

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
