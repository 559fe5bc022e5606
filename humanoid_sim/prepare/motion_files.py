"""Motions in files: `.npz` of mjlab and whole_body_tracking with the robot's state in the world, and `.csv`."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.terms import QuaternionOrder
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.npz_file import read_arrays
from humanoid_sim.prepare.source_motion import SourceMotion, joint_of

_NPZ_KEYS = {
    "fps": "",
    "joint_pos": "(F, n)",
    "joint_vel": "(F, n)",
    "body_pos_w": "(F, B, 3)",
    "body_quat_w": "(F, B, 4)",
}
"""Arrays that are needed, and their shapes. Body velocities are in the file too; nothing here uses them."""

_NPZ_LAST_AXIS = {"body_pos_w": 3, "body_quat_w": 4}

_BASE_NAMES = ("base_x", "base_y", "base_z", "base_qx", "base_qy", "base_qz", "base_qw")
_BASE = len(_BASE_NAMES)
"""Columns of the base's pose: x y z and a quaternion."""

_BASE_COLUMNS = {
    **{f"{prefix}{axis}": axis for prefix in ("", "base_", "root_", "base_pos_", "root_pos_") for axis in "xyz"},
    **{f"{prefix}q{axis}": f"q{axis}" for prefix in ("", "base_", "root_") for axis in "wxyz"},
    **{f"{prefix}_quat_{axis}": f"q{axis}" for prefix in ("base", "root") for axis in "wxyz"},
}
"""Names of columns, and which part of the base's pose they are."""

_UNEVEN = 0.25
"""Share of the mean step: rounding to milliseconds makes steps uneven, a frame left out makes one twice as long."""
_DIGIT = 0.001
"""s"""
_TIMES = ("time", "t", "timestamp")
_INDICES = ("frame", "index")


def read_npz(path: Path) -> SourceMotion:
    """Read a motion of whole_body_tracking (joints and bodies in Isaac's order) or mjlab (in MJCF order).

    The format has no names; files that hold `joint_names` and `body_names` all the same are believed.
    """
    arrays = read_arrays(path)
    missing = [key for key in _NPZ_KEYS if key not in arrays]
    if missing:
        raise InputError(
            f"{path}: has no {', '.join(missing)}; it holds {', '.join(sorted(arrays)) or 'nothing'}, "
            f"expected {', '.join(_NPZ_KEYS)}"
        )
    for key, shape in _NPZ_KEYS.items():
        array = arrays[key]
        if array.dtype.kind not in "fiu":
            raise InputError(f"{path}: {key} has type {array.dtype}, expected numbers")
        if shape and (
            array.ndim != shape.count(",") + 1 or array.shape[-1] != _NPZ_LAST_AXIS.get(key, array.shape[-1])
        ):
            raise InputError(f"{path}: {key} has shape {array.shape}, expected {shape}")
    if arrays["fps"].size != 1:
        raise InputError(f"{path}: fps has shape {arrays['fps'].shape}, expected one number")
    return SourceMotion(
        source=str(path),
        kind="npz",
        fps=float(arrays["fps"].reshape(())),
        joint_position=arrays["joint_pos"],
        joint_velocity=arrays["joint_vel"],
        joint_names=_npz_names(path, arrays, "joint_names"),
        body_position=arrays["body_pos_w"],
        body_quaternion=arrays["body_quat_w"],
        body_names=_npz_names(path, arrays, "body_names") or (),
    )


def _npz_names(path: Path, arrays: dict[str, npt.NDArray[Any]], key: str) -> tuple[str, ...] | None:
    if key not in arrays:
        return None
    if arrays[key].dtype.kind != "U" or arrays[key].ndim != 1:
        raise InputError(f"{path}: {key} is {arrays[key].dtype} of shape {arrays[key].shape}, expected a list of texts")
    return tuple(str(name) for name in arrays[key])


def read_csv(
    path: Path, joint_names: tuple[str, ...], fps: float | None, *, floating: bool, quaternions: QuaternionOrder | None
) -> SourceMotion:
    """Read a motion in one of two forms.

    Without a header, as LAFAN1 for the G1 and whole_body_tracking have it: base position x y z, base quaternion
    x y z w, then the joint positions; of a robot with a fixed base the joint positions may be alone. With a header:
    columns by name, joints as the robot names them, base as `base_x … base_qw`, optionally `time` in s or `frame`.

    Frames per second are None where a column `time` gives them. A robot with a `floating` base needs its pose.
    `quaternions` is the order of a headless file's; None for x y z w.
    """
    rows = _csv_rows(path)
    if not rows:
        raise InputError(f"{path}: is empty, expected one frame per line")
    first_line, first = rows[0]
    if any(_number(cell) is None for cell in first):
        if len(rows) == 1:
            raise InputError(f"{path}: line {first_line} is not a frame of numbers, and none follows it")
        return _named_columns(path, first, _csv_table(path, rows[1:]), joint_names, fps, floating)
    table = _csv_table(path, rows)
    joints = len(joint_names)
    if fps is None:
        raise InputError(f"{path}: does not state its frame rate; use --fps")
    order: QuaternionOrder = quaternions or "xyzw"
    said_by = "--quaternions" if quaternions else "assumed: csv"
    if table.shape[1] == _BASE + joints:
        return SourceMotion(
            source=str(path),
            kind="csv",
            fps=fps,
            joint_position=table[:, _BASE:],
            base_position=table[:, :3],
            base_quaternion=table[:, 3:7],
            quaternion_order=order,
            quaternion_order_source=said_by,
        )
    if table.shape[1] == joints and not floating:
        return SourceMotion(source=str(path), kind="csv", fps=fps, joint_position=table)
    accepted = f"{_BASE + joints}, base pose and {joints} joints" + ("" if floating else f", or the {joints} joints")
    raise InputError(f"{path}: line {first_line} has {table.shape[1]} numbers, expected {accepted}")


def _named_columns(
    path: Path, names: list[str], table: FloatArray, joints: tuple[str, ...], fps: float | None, floating: bool
) -> SourceMotion:
    if len(names) != table.shape[1]:
        raise InputError(f"{path}: has {len(names)} column names and {table.shape[1]} numbers per line")
    places: dict[str, int] = {}
    unknown = []
    for i, name in enumerate(names):
        role = _csv_role(name, joints)
        if role is None:
            unknown.append(name)
        elif role in places:
            raise InputError(f"{path}: columns '{names[places[role]]}' and '{name}' mean the same")
        else:
            places[role] = i
    if unknown:
        raise InputError(f"{path}: {known_names('column', unknown[0], ('time', 'frame', *_BASE_NAMES, *joints))}")
    found = tuple(joint for joint in joints if joint in places)
    missing = [joint for joint in joints if joint not in places]
    base = [places.get(role) for role in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    if missing:
        raise InputError(f"{path}: has no column for {', '.join(missing)}")
    if any(place is None for place in base) and (floating or any(place is not None for place in base)):
        raise InputError(f"{path}: needs all of the columns {', '.join(_BASE_NAMES)}")
    pose = None if base[0] is None else table[:, [place for place in base if place is not None]]
    return SourceMotion(
        source=str(path),
        kind="csv with column names",
        fps=_csv_rate(path, table[:, places["time"]] if "time" in places else None, fps),
        joint_position=table[:, [places[joint] for joint in found]],
        joint_names=found,
        base_position=None if pose is None else pose[:, :3],
        base_quaternion=None if pose is None else pose[:, 3:],
        quaternion_order_source="column names",
    )


def _csv_role(name: str, joints: tuple[str, ...]) -> str | None:
    """Return what a column is: `time`, `frame`, an axis of the base or a joint; None for unknown."""
    joint = joint_of(name.strip(), joints)
    if joint is not None:
        return joint
    lower = name.strip().lower()
    if lower in _TIMES:
        return "time"
    if lower in _INDICES:
        return "frame"
    return _BASE_COLUMNS.get(lower)


def _csv_rate(path: Path, times: FloatArray | None, fps: float | None) -> float:
    if times is None:
        if fps is None:
            raise InputError(f"{path}: has no column 'time' and does not state its frame rate; use --fps")
        return fps
    steps = np.diff(times)
    if not len(steps) or not np.isfinite(steps).all() or steps.min() <= 0.0:
        raise InputError(f"{path}: column 'time' does not increase from frame to frame")
    if np.abs(steps - steps.mean()).max() > _UNEVEN * steps.mean():
        frame = int(np.abs(steps - steps.mean()).argmax())
        raise InputError(
            f"{path}: frames are not evenly spaced in time: {steps[frame]:g} s after frame {frame}, "
            f"{steps.mean():g} s on average"
        )
    rate = 1.0 / float(steps.mean())
    # Times are written with few digits, often milliseconds: 0, 0.033, 0.067 are 30 frames per second.
    rate = round(rate) if abs(rate - round(rate)) * (times[-1] - times[0]) < _DIGIT * rate else rate
    if fps is not None and abs(fps - rate) > 0.02 * rate:
        raise InputError(f"{path}: --fps is {fps:g}, and its column 'time' says {rate:g} frames per second")
    return float(rate) if fps is None else fps


def _csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """Line number and cells of every line that is not empty."""
    try:
        with regular_file(path, "a .csv file").open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path}: is not a text file of numbers separated by commas") from None


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _csv_table(path: Path, rows: list[tuple[int, list[str]]]) -> FloatArray:
    values = []
    for line, row in rows:
        if len(row) != len(rows[0][1]):
            raise InputError(f"{path}: line {line} has {len(row)} numbers, the lines before {len(rows[0][1])}")
        numbers = []
        for place, cell in enumerate(row):
            number = _number(cell)
            if number is None:
                raise InputError(f"{path}: line {line}, column {place + 1}: '{cell.strip()}' is not a number")
            numbers.append(number)
        values.append(numbers)
    return np.array(values, dtype=np.float64)
