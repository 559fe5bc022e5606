"""The environments by name, for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

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
    """Register every environment that is not registered yet. Imports Gymnasium, and nothing that simulates."""
    from gymnasium.envs.registration import register, registry  # noqa: PLC0415 - only who uses Gymnasium waits for it

    for name, arguments in ENVIRONMENTS.items():
        if name not in registry:
            register(name, **arguments)


def register_with_gymnasium() -> None:
    """Register now if Gymnasium is imported, else as soon as it is: importing it here would slow every program down."""
    if sys.modules.get("gymnasium") is not None:
        register_environments()
    else:
        sys.meta_path.insert(0, _AfterGymnasium())


class _AfterGymnasium(MetaPathFinder):
    """Sees Gymnasium's import go by, and registers when it is complete.

    It stays where it is until then: `importlib.util.find_spec("gymnasium")`, by which others see whether there is one,
    comes by here too, and imports nothing.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        others = (finder.find_spec(fullname, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((found for found in others if found is not None), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                register_environments()
                if self in sys.meta_path:
                    sys.meta_path.remove(self)

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
