"""What chooses actions in a model of stable-baselines3 or rsl_rl, as far as a file of a policy can hold it."""

from __future__ import annotations

from typing import Any, Protocol

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.network import Float32Array, Network

__all__ = ["Actor", "actor_of"]


class Actor(Protocol):
    """The part of a model that is exported."""

    def network(self) -> Network:
        """As it is exported.

        Raises:
            InputError: it is none of linear layers.
        """

    def answer(self, observations: Float32Array) -> Float32Array:
        """Raw actions (k, m) for observations (k, N), as the library computes them."""


def actor_of(model: Any, envs: Any = None) -> Actor:
    """The actor of a model.

    Args:
        model: of stable-baselines3, or a runner of rsl_rl.
        envs: around which it was trained; those of stable-baselines3 may normalise observations.

    Raises:
        InputError: it is no such model.
    """
    library = {kind.__module__.partition(".")[0] for kind in type(model).__mro__}
    if "stable_baselines3" in library:
        from humanoid_sim.training.ppo.sb3 import StableBaselinesActor  # noqa: PLC0415 - one of them is enough

        return StableBaselinesActor(model, envs)
    if "rsl_rl" in library:
        from humanoid_sim.training.ppo.rsl import RslRlActor  # noqa: PLC0415

        return RslRlActor(model)
    raise InputError(f"model: is a {type(model).__name__}, expected a model of stable-baselines3 or a runner of rsl_rl")
