"""Public robots by name: `robot_descriptions:g1` is the MJCF that the package robot_descriptions knows as `g1`."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import pkgutil
import sys
from pathlib import Path

from humanoid_sim.errors import InputError, needing, reason_of

PREFIX = "robot_descriptions:"
_URDF, _MJCF = "_description", "_mj_description"


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot, whose repository is cloned at its first use, with progress on stderr.

    Raises `InputError` if the robot is unknown or cannot be fetched.
    """
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    modules = sorted(module.name for module in pkgutil.iter_modules(robot_descriptions.__path__))
    short = name.removeprefix(PREFIX).removesuffix(_MJCF).removesuffix(_URDF)
    known = [module.removesuffix(_MJCF) for module in modules if module.endswith(_MJCF)]
    if short in known:
        try:
            with contextlib.redirect_stdout(sys.stderr):
                return Path(importlib.import_module(f"robot_descriptions.{short}{_MJCF}").MJCF_PATH)
        except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
            raise InputError(f"{name}: could not be fetched: {reason_of(error)}") from None
    if f"{short}{_URDF}" in modules:
        raise InputError(f"{name}: is there as a URDF only; `python -m humanoid_sim.robot convert` makes an MJCF of it")
    plain = short.lower().replace("-", "_")
    near = [robot for robot in known if plain.endswith(f"_{robot}")]  # `g1` of `unitree_g1`
    near = near or difflib.get_close_matches(plain, known, cutoff=0.7)
    others = f"near: {', '.join(near)}" if near else f"known: {', '.join(known)}"
    raise InputError(f"{name}: unknown public robot; {others}")
