"""A class or function of the user's own, named on the command line."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from humanoid_sim.errors import InputError, known_names, reason_of
from humanoid_sim.files import is_file

__all__ = ["FORM", "is_own", "own_object"]

FORM = "FILE.py:NAME or MODULE:NAME"


def is_own(text: str) -> bool:
    """Whether a value is meant as the name of somebody's own code."""
    return ":" in text


def own_object(option: str, text: str) -> Any:
    """What `text` names: `examples/own_task.py:HoldTask`, or `my_package.tasks:HoldTask`.

    Args:
        option: which says so, for messages.
        text: a file or a module that can be imported, a colon, and a name in it.

    Raises:
        InputError: there is no such file, module or name, or it fails as it is imported.
    """
    place, _, name = text.rpartition(":")
    if not place or not name.isidentifier():
        raise InputError(f"{option}: is '{text}', expected {FORM}")
    try:
        module = _from_file(option, Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except InputError:
        raise
    except ModuleNotFoundError as error:
        raise InputError(f"{option}: '{place}' cannot be imported: no module '{error.name}'") from None
    except (Exception, SystemExit) as error:  # whatever somebody's code does
        raise InputError(
            f"{option}: '{place}' cannot be imported: {type(error).__name__}: {reason_of(error)}"
        ) from None
    if not hasattr(module, name):
        names = [each for each in vars(module) if not each.startswith("_")]
        raise InputError(f"{option}: {known_names('name', name, names, listed=False)} in '{place}'")
    return getattr(module, name)


def _from_file(option: str, path: Path) -> ModuleType:
    if not is_file(path):
        raise InputError(f"{option}: '{path}': no such file")
    name = f"humanoid_sim_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
