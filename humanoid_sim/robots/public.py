"""Public robots by name: `robot_descriptions:g1` is the MJCF that the package robot_descriptions knows as `g1`."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys
from pathlib import Path

from humanoid_sim.errors import InputError, needing, reason_of, require_known

PREFIX = "robot_descriptions:"
_MJCF = "_mj_description"  # of its modules with an MJCF


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot, whose repository is cloned at its first use, with progress on stderr.

    Raises `InputError` if the robot is unknown or cannot be fetched, `MissingPackageError` without the package.
    """
    short = name.removeprefix(PREFIX)
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    modules = [module.name for module in pkgutil.iter_modules(robot_descriptions.__path__)]
    known = sorted(module.removesuffix(_MJCF) for module in modules if module.endswith(_MJCF))
    require_known("public robot with an MJCF", [short], known, f"{name}: ")
    try:
        with contextlib.redirect_stdout(sys.stderr):
            return Path(importlib.import_module(f"robot_descriptions.{short}{_MJCF}").MJCF_PATH)
    except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
        raise InputError(
            f"{name}: could not be fetched: {reason_of(error)}; git clones it at its first use, into "
            "~/.cache/robot_descriptions or the folder that ROBOT_DESCRIPTIONS_CACHE names"
        ) from None
