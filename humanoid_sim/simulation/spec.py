"""MJCF files read and compiled, with errors in one line."""

from __future__ import annotations

from pathlib import Path

import mujoco

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file

__all__ = ["compile_spec", "read_spec"]


def read_spec(path: Path) -> mujoco.MjSpec:
    """The editable model of an MJCF file, its includes resolved.

    Raises:
        InputError: there is no such file, or it is not an MJCF.
    """
    regular_file(path, "the robot's MJCF model")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path}: not a valid MJCF model: {_one_line(error)}") from None


def compile_spec(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """Compile; `path` is what to call it in messages.

    Raises:
        InputError: the model does not compile.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(f"{path}: does not compile: {_one_line(error)}") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
