"""The environments by name, for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

_POLICY = {
    "entry_point": "humanoid_sim.envs.policy_env:PolicyEnv",
    "vector_entry_point": "humanoid_sim.envs.vector_env:PolicyVectorEnv",
}
_TRACKING = {"contract": "lite_tracking", "robot": "lite", "motion": "wave"}
_VELOCITY = {"contract": "lite_biped_velocity", "robot": "lite_biped"}
_PIANO = {"contract": "lite_piano_task", "robot": "lite_piano", "motion": "ode_to_joy"}
_STACK = {"robot": "lite", "policy": "lite_tracking", "motion": "wave"}

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    "humanoid_sim/LiteTracking-v0": {**_POLICY, "kwargs": _TRACKING},
    "humanoid_sim/BipedVelocity-v0": {**_POLICY, "kwargs": _VELOCITY},
    "humanoid_sim/LitePiano-v0": {**_POLICY, "kwargs": _PIANO},
    "humanoid_sim/Policy-v0": _POLICY,
    "humanoid_sim/LiteModes-v0": {"entry_point": "humanoid_sim.envs.modes_env:ModesEnv", "kwargs": _STACK},
}
"""Arguments of `gymnasium.register` by id."""


def register_environments() -> None:
    """Register every environment that is not registered yet."""
    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            register(name, **arguments)
