"""Public robots by name: `robot_descriptions:g1` is the MJCF that the package robot_descriptions knows as `g1`."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import pkgutil
import sys
from pathlib import Path

from humanoid_sim.errors import InputError, MissingPackageError, needing, reason_of

PREFIX = "robot_descriptions:"
_URDF, _MJCF = "_description", "_mj_description"


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot, whose repository is cloned at its first use, with progress on stderr.

    Raises `InputError` if the robot is unknown or cannot be fetched, `MissingPackageError` without the package.
    """
    short = name.removeprefix(PREFIX).removesuffix(_MJCF).removesuffix(_URDF)
    known = _robots(_MJCF)
    if short in known:
        try:
            with contextlib.redirect_stdout(sys.stderr):
                return Path(importlib.import_module(f"robot_descriptions.{short}{_MJCF}").MJCF_PATH)
        except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
            raise InputError(f"{name}: could not be fetched: {reason_of(error)}") from None
    if short in _robots(_URDF):
        raise InputError(f"{name}: is there as a URDF only; `python -m humanoid_sim.robot convert` makes an MJCF of it")
    near = _near(short, known)
    others = f"near: {near}" if near else f"known: {', '.join(known)}"
    raise InputError(f"{name}: unknown public robot; {others}")


def near_public(name: str) -> str:
    """Return the public robot that a name without the prefix probably means, with the prefix; '' for none."""
    try:
        near = _near(name, _robots(_MJCF))
    except MissingPackageError:
        return ""
    return f"{PREFIX}{near}" if near else ""


def _near(name: str, known: list[str]) -> str:
    """Return the name that was probably meant, `g1` of `unitree_g1`, `talos` of `talso`; '' for none."""
    plain = name.lower().replace("-", "_")
    without_vendor = [short for short in known if plain.endswith(f"_{short}")]
    return next(iter(without_vendor or difflib.get_close_matches(plain, known, n=1, cutoff=0.7)), "")


def _robots(suffix: str) -> list[str]:
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    modules = [module.name for module in pkgutil.iter_modules(robot_descriptions.__path__)]
    return sorted(module.removesuffix(suffix) for module in modules if module.endswith(suffix))
