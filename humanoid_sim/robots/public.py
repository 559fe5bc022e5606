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
_MJCF, _URDF = "_mj_description", "_description"


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot, whose repository is cloned at its first use, with progress on stderr.

    Raises `InputError` if the robot is unknown or cannot be fetched, `MissingPackageError` without the package.
    """
    short = name.removeprefix(PREFIX).removesuffix(_MJCF)
    modules = _modules()
    if short + _MJCF not in modules:
        if short + _URDF in modules or short in modules:
            hint = "`python -m humanoid_sim.robot convert` makes an MJCF of one"
            raise InputError(f"{name}: robot_descriptions has this robot as a URDF only; {hint}")
        near = _near(short, modules)
        hint = f"near: {', '.join(near)}" if near else f"known: {', '.join(_names(modules))}"
        raise InputError(f"{name}: unknown public robot; {hint}")
    try:
        with contextlib.redirect_stdout(sys.stderr):
            module = importlib.import_module(f"robot_descriptions.{short}{_MJCF}")
    except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
        raise InputError(
            f"{name}: could not be fetched: {reason_of(error)}; git clones it at its first use, into "
            "~/.cache/robot_descriptions or the folder that ROBOT_DESCRIPTIONS_CACHE names"
        ) from None
    return Path(module.MJCF_PATH)


def near_public(name: str) -> str:
    """Return the public robot that a name without the prefix probably means, with the prefix; '' for none."""
    try:
        near = _near(name, _modules())
    except MissingPackageError:
        return ""
    return f"{PREFIX}{near[0]}" if near else ""


def _near(name: str, modules: frozenset[str]) -> list[str]:
    """Return the names like this one, the likeliest first: `g1` of `unitree_g1`, `talos` of `talso`."""
    names = _names(modules)
    parts = name.lower().replace("-", "_").split("_")
    without_vendor = ["_".join(parts[i:]) for i in range(len(parts))]
    like = difflib.get_close_matches("_".join(parts), names, n=5, cutoff=0.7)
    return list(dict.fromkeys([short for short in without_vendor if short in names] + like))


def _names(modules: frozenset[str]) -> list[str]:
    return sorted(module.removesuffix(_MJCF) for module in modules if module.endswith(_MJCF))


def _modules() -> frozenset[str]:
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    return frozenset(module.name for module in pkgutil.iter_modules(robot_descriptions.__path__))
