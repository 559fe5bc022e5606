"""The environments by name, for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

_POLICY = {
    "entry_point": "humanoid_sim.envs.policy_env:PolicyEnv",
    "vector_entry_point": "humanoid_sim.envs.vector_env:PolicyVectorEnv",
}
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "humanoid_sim/LiteTracking-v0": {**_POLICY, "kwargs": {"config": "lite_tracking"}},
    "humanoid_sim/BipedVelocity-v0": {**_POLICY, "kwargs": {"config": "biped_velocity"}},
    "humanoid_sim/LitePiano-v0": {**_POLICY, "kwargs": {"config": "lite_piano"}},
    "humanoid_sim/LiteModes-v0": {"entry_point": "humanoid_sim.envs.modes_env:ModesEnv"},
}
"""Arguments of `gymnasium.register` by id."""


def register_environments() -> None:
    """Register every environment that is not registered yet."""
    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            register(name, **arguments)
