"""Register the environments when Gymnasium is there, without importing it for those who do not use it.

`import humanoid_sim` has to be enough for `gymnasium.make("humanoid_sim/LiteTracking-v0")`. Gymnasium takes longer to
import than all that `play --help` needs, so the registration waits for the import of Gymnasium itself.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

__all__ = ["register_with_gymnasium"]


def register_with_gymnasium() -> None:
    """Register now if Gymnasium is imported, else as soon as it is."""
    if "gymnasium" in sys.modules:
        _register()
    elif not any(isinstance(finder, _GymnasiumFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _GymnasiumFinder())


def _register() -> None:
    from humanoid_sim.envs.registration import register_environments  # noqa: PLC0415 - imports Gymnasium

    register_environments()


class _GymnasiumFinder(MetaPathFinder):
    """Finds Gymnasium as the usual finder does, once, and has the environments registered after it."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = _RegisteringLoader(spec.loader)
        return spec


class _RegisteringLoader(Loader):
    """Gymnasium's own loader, and then the registration."""

    def __init__(self, loader: Loader) -> None:
        self._loader = loader

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader  # whoever asks for data files of the package asks the real one
        self._loader.exec_module(module)
        _register()
