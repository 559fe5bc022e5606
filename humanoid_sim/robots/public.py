"""Public robots by name: `robot_descriptions:g1` is the MJCF that the package robot_descriptions knows as `g1`."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import pkgutil
import sys
from pathlib import Path

from humanoid_sim.errors import InputError, blaming, needing

PREFIX = "robot_descriptions:"
_MJCF = "_mj_description"


def public_mjcf(name: str) -> Path:
    """Return the MJCF of a public robot, whose repository is cloned at its first use."""
    with needing("robot_descriptions", "menagerie", f"--robot {PREFIX}…"):
        import robot_descriptions  # noqa: PLC0415 - an extra
    modules = [module.name for module in pkgutil.iter_modules(robot_descriptions.__path__)]
    known = sorted(module.removesuffix(_MJCF) for module in modules if module.endswith(_MJCF))
    short = name.removeprefix(PREFIX).removesuffix(_MJCF)
    if short not in known:
        plain = short.lower().replace("-", "_")
        near = [robot for robot in known if plain.endswith(f"_{robot}")]  # `g1` of `unitree_g1`
        near = near or difflib.get_close_matches(plain, known, cutoff=0.7)
        raise InputError(f"{name}: unknown public robot with an MJCF; near or known: {', '.join(near or known)}")
    # Errors are of git, of the network, of the disk; progress is no output.
    with blaming(f"{name}: could not be fetched", Exception), contextlib.redirect_stdout(sys.stderr):
        return Path(importlib.import_module(f"robot_descriptions.{short}{_MJCF}").MJCF_PATH)
