"""Motions of mjlab and whole_body_tracking: `.npz` files with the state of the robot in the world, frame by frame."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file
from humanoid_sim.prepare.source import SourceMotion

__all__ = ["read_npz"]

_KEYS = {
    "fps": "",
    "joint_pos": "(F, n)",
    "joint_vel": "(F, n)",
    "body_pos_w": "(F, B, 3)",
    "body_quat_w": "(F, B, 4)",
}
"""What is needed, and its shape. Body velocities are in the file too; nothing here uses them."""

_LAST_AXIS = {"body_pos_w": 3, "body_quat_w": 4}


def read_npz(path: Path) -> SourceMotion:
    """Read a motion of whole_body_tracking (joints and bodies in Isaac's order) or mjlab (in MJCF order).

    The format has no names; files that hold `joint_names` and `body_names` all the same are believed.

    Raises:
        InputError: one line with the file and what is wrong with it.
    """
    arrays = _load(path)
    missing = [key for key in _KEYS if key not in arrays]
    if missing:
        raise InputError(
            f"{path}: has no {', '.join(missing)}; it holds {', '.join(sorted(arrays)) or 'nothing'}, "
            f"expected {', '.join(_KEYS)}"
        )
    for key, shape in _KEYS.items():
        array = arrays[key]
        if array.dtype.kind not in "fiu":
            raise InputError(f"{path}: {key} has type {array.dtype}, expected numbers")
        if shape and (array.ndim != shape.count(",") + 1 or array.shape[-1] != _LAST_AXIS.get(key, array.shape[-1])):
            raise InputError(f"{path}: {key} has shape {array.shape}, expected {shape}")
    if arrays["fps"].size != 1:
        raise InputError(f"{path}: fps has shape {arrays['fps'].shape}, expected one number")
    return SourceMotion(
        source=str(path),
        kind="npz",
        fps=float(arrays["fps"].reshape(())),
        joint_position=arrays["joint_pos"],
        joint_velocity=arrays["joint_vel"],
        joint_names=_names(path, arrays, "joint_names"),
        body_position=arrays["body_pos_w"],
        body_quaternion=arrays["body_quat_w"],
        body_names=_names(path, arrays, "body_names"),
    )


def _load(path: Path) -> dict[str, npt.NDArray[Any]]:
    try:
        # Opened here: NumPy leaves a bad archive that it opened itself open.
        with regular_file(path, "an .npz file").open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            if isinstance(archive, np.ndarray):
                raise InputError(f"{path}: holds a single array (.npy), expected an .npz file")
            return {key: archive[key] for key in archive.files}
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError, KeyError) as error:
        # NumPy says ValueError for pickled objects, which may run code, and for what is no NumPy file at all.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: is no whole .npz file of plain arrays: {reason}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _names(path: Path, arrays: dict[str, npt.NDArray[Any]], key: str) -> tuple[str, ...] | None:
    if key not in arrays:
        return None
    if arrays[key].dtype.kind != "U" or arrays[key].ndim != 1:
        raise InputError(f"{path}: {key} is {arrays[key].dtype} of shape {arrays[key].shape}, expected a list of texts")
    return tuple(str(name) for name in arrays[key])
