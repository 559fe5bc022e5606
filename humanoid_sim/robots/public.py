"""Public robots by name: `robot_descriptions:g1` is the MJCF that the package robot_descriptions knows as `g1`."""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys
from pathlib import Path

from humanoid_sim.errors import InputError, MissingPackageError, known_names, reason_of
from humanoid_sim.names import near_miss

PREFIX = "robot_descriptions:"
_MJCF, _URDF = "_mj_description", "_description"


def public_robots() -> tuple[str, ...]:
    """Names of the robots whose MJCF that package knows.

    Raises:
        MissingPackageError: it is not installed.
    """
    return tuple(sorted(name.removesuffix(_MJCF) for name in _modules() if name.endswith(_MJCF)))


def public_name(name: str) -> str:
    """Return the public robot that was probably meant by a name without the prefix, with it; '' for none.

    Also '' where robot_descriptions is not installed: nobody knows its names then.
    """
    try:
        known = public_robots()
    except MissingPackageError:
        return ""
    parts = name.lower().replace("-", "_").split("_")
    without_vendor = ("_".join(parts[i:]) for i in range(len(parts)))
    found = next((short for short in without_vendor if short in known), "") or near_miss(name, known)
    return f"{PREFIX}{found}" if found else ""


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot. At its first use its repository is cloned, with progress on stderr.

    Args:
        name: with the prefix, as the user gave it.

    Raises:
        InputError: there is no such robot, or it cannot be had now.
        MissingPackageError: robot_descriptions is not installed.
    """
    short = name.removeprefix(PREFIX).removesuffix(_MJCF)
    known = public_robots()
    if short not in known:
        if short + _URDF in _modules() or short in _modules():
            raise InputError(
                f"{name}: robot_descriptions has this robot as a URDF only; "
                "`python -m humanoid_sim.robot convert` makes an MJCF of one"
            )
        raise InputError(known_names("public robot", short, known))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            module = importlib.import_module(f"robot_descriptions.{short}{_MJCF}")
    except Exception as error:  # of git, of the network, of the disk: whatever it is, the robot is not here
        raise InputError(
            f"{name}: could not be fetched: {reason_of(error)}; it is cloned with git at its first use, which needs a "
            "network, into ~/.cache/robot_descriptions, or into the folder that ROBOT_DESCRIPTIONS_CACHE names"
        ) from None
    return Path(module.MJCF_PATH)


def _modules() -> frozenset[str]:
    try:
        import robot_descriptions  # noqa: PLC0415 - an extra
    except ImportError:
        raise MissingPackageError("robot_descriptions", "menagerie", f"--robot {PREFIX}…") from None
    return frozenset(module.name for module in pkgutil.iter_modules(robot_descriptions.__path__))
