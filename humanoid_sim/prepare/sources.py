"""Motions as their sources have them: `.npz` of mjlab and whole_body_tracking, `.csv`, joint states in MCAP files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from humanoid_sim.controllers.contract import QuaternionOrder
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.files import regular_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.npz_file import read_arrays
from humanoid_sim.ros2.cdr import CdrError, CdrReader
from humanoid_sim.ros2.definitions import JOINT_STATE

_UNIT = 0.02  # largest distance of a quaternion's norm from 1: rounding and interpolation leave much less
_LONGEST_GAP = 0.1  # s between two frames, if that is also more than three of the usual steps
_JOINT_SUFFIXES = ("", ".pos", "_pos", "_dof")  # that exporters append to a joint's name
_NPZ_SHAPES: dict[str, tuple[int, ...]] = {
    "joint_pos": (-1, -1),
    "joint_vel": (-1, -1),
    "body_pos_w": (-1, -1, 3),
    "body_quat_w": (-1, -1, 4),
    "fps": (1,),
}
"""Arrays that are needed, and their shapes; -1 for any length."""
_BASE_COLUMNS = ("base_x", "base_y", "base_z", "base_qw", "base_qx", "base_qy", "base_qz")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SourceMotion:
    """One episode of F frames. What the source does not hold, or does not say, is None.

    A pose is a position in m, followed by a unit quaternion in `quaternion_order`.
    """

    source: str
    """Name for messages."""
    kind: str
    """Format, for the printed summary."""
    times: FloatArray
    """Shape (F,), s."""
    joints: FloatArray | None = None
    """Positions, shape (F, n), in `angle_unit`."""
    joint_velocity: FloatArray | None = None
    """Shape (F, n), `angle_unit` per second."""
    joint_names: tuple[str, ...] | None = None
    base: FloatArray | None = None
    """Pose of the robot's base body in the world, shape (F, 7)."""
    bodies: FloatArray | None = None
    """Poses in `frame`, shape (F, B, 7)."""
    body_names: tuple[str, ...] | None = None
    frame: Literal["world", "base"] = "world"
    """Frame of `bodies`: the world, or that of the robot's base body."""
    quaternion_order: QuaternionOrder | None = None
    angle_unit: Literal["rad", "deg"] | None = None

    def __post_init__(self) -> None:
        if self.joints is None and self.bodies is None:
            raise InputError(f"{self.source}: holds neither joint positions nor body poses")
        velocity = self.joint_velocity
        if velocity is not None and (self.joints is None or self.joints.shape != velocity.shape):
            raise InputError(f"{self.source}: has joint velocities of another shape than the positions")
        for name, array in {"times": self.times, **self.arrays()}.items():
            if len(array) != len(self.times) or not len(array):
                raise InputError(f"{self.source}: {name} has {len(array)} frames, expected {len(self.times) or 'some'}")
            bad = np.argwhere(~np.isfinite(array))
            if len(bad):
                raise InputError(f"{self.source}: {name} is {array[tuple(bad[0])]} in frame {bad[0][0]}, not finite")
            norm = np.sqrt((array[..., 3:] ** 2).sum(axis=-1)) if name in ("base", "bodies") else np.ones(1)
            if np.abs(norm - 1.0).max() > _UNIT:
                raise InputError(f"{self.source}: {name} has quaternions of norm {norm.min():.3g} to {norm.max():.3g}")
        steps = np.diff(self.times, append=self.times[-1] + 1e-3)
        if steps.min() <= 0.0:
            raise InputError(f"{self.source}: time does not increase after frame {int(steps.argmin())}")
        if steps.max() > max(_LONGEST_GAP, 3.0 * float(np.median(steps))):
            raise InputError(f"{self.source}: has a gap of {steps.max():.3g} s after frame {int(steps.argmax())}")

    def arrays(self) -> dict[str, FloatArray]:
        """Return what the source holds, by field; each of F rows."""
        fields = ("joints", "joint_velocity", "base", "bodies")
        return {field: getattr(self, field) for field in fields if getattr(self, field) is not None}

    @property
    def rate(self) -> float:
        """Mean frames per second; 0 for a single frame."""
        count = len(self.times)
        return (count - 1) / float(self.times[-1] - self.times[0]) if count > 1 else 0.0


def joint_of(column: str, joints: tuple[str, ...]) -> str | None:
    """Return the joint whose position a column is by its name; None if there is none."""
    names = (column.removesuffix(suffix) for suffix in _JOINT_SUFFIXES if column.endswith(suffix))
    return next((name for name in names if name in joints), None)


def even_times(count: int, fps: float, source: str) -> FloatArray:
    """Return the times of frames at a fixed rate, from 0: shape (count,), s."""
    if not 0.0 < fps < np.inf:
        raise InputError(f"{source}: fps is {fps:g}, expected a positive number of frames per second")
    times: FloatArray = np.arange(count) / fps
    return times


def derivative(joints: FloatArray, times: FloatArray) -> FloatArray:
    """Return the central differences of (F, n), one-sided at the ends; zeros of a single frame."""
    rate: FloatArray = np.gradient(joints, times, axis=0) if len(times) > 1 else np.zeros_like(joints)
    return rate


def poses(position: FloatArray, quaternion: FloatArray, source: str) -> FloatArray:
    """Join positions (F, B, 3) and quaternions (F, B, 4)."""
    if position.shape[:-1] != quaternion.shape[:-1]:
        raise InputError(f"{source}: has {position.shape[:-1]} body positions and {quaternion.shape[:-1]} orientations")
    return np.concatenate([position, quaternion], axis=-1)


def read_npz(path: Path) -> SourceMotion:
    """Read a motion of mjlab or whole_body_tracking; names only if somebody added them."""
    arrays = read_arrays(path)
    read: dict[str, FloatArray] = {}
    for key, shape in _NPZ_SHAPES.items():
        if key not in arrays:
            raise InputError(f"{path}: has no {key}; it holds {', '.join(sorted(arrays)) or 'nothing'}")
        array = np.atleast_1d(arrays[key])
        is_right = array.ndim == len(shape) and all(own in (-1, n) for own, n in zip(shape, array.shape, strict=True))
        if not is_right or array.dtype.kind not in "fiu":
            raise InputError(f"{path}: {key} is {array.dtype} of shape {array.shape}, expected numbers, shape {shape}")
        read[key] = array.astype(np.float64)
    names = {key: tuple(map(str, arrays[key].ravel())) for key in ("joint_names", "body_names") if key in arrays}
    return SourceMotion(
        source=str(path),
        kind="npz",
        times=even_times(len(read["joint_pos"]), float(read["fps"][0]), str(path)),
        joints=read["joint_pos"],
        joint_velocity=read["joint_vel"],
        joint_names=names.get("joint_names"),
        bodies=poses(read["body_pos_w"], read["body_quat_w"], str(path)),
        body_names=names.get("body_names"),
    )


def read_csv(path: Path, joints: tuple[str, ...], fps: float | None) -> SourceMotion:
    """Read a table with a frame in each line.

    With column names: `time` in s, `base_x … base_qz`, and each joint by its name, in any order. Numbers alone: base
    position, base quaternion and joint positions, as LAFAN1 for the G1, or joint positions.
    """
    with blaming(f"{path}: is not a table of numbers", (OSError, ValueError)):
        lines = regular_file(path, "a .csv file").read_text(encoding="utf-8-sig").splitlines()
        lines = [line for line in lines if line.strip()]
        has_names = bool(lines) and re.search("[a-df-z]", lines[0], re.IGNORECASE) is not None  # e: 1e-3
        if len(lines) <= has_names:
            raise InputError(f"{path}: has no frames")
        table = np.loadtxt(lines[has_names:], delimiter=",", ndmin=2)
    known = ("time", *_BASE_COLUMNS, *joints)
    if has_names:
        parts = [joint_of(name.strip(' "'), joints) or name.strip(' "') for name in lines[0].split(",")]
    elif table.shape[1] in (len(joints), len(joints) + len(_BASE_COLUMNS)):
        parts = list(known[-table.shape[1] :])
    else:
        raise InputError(
            f"{path}: has {table.shape[1]} columns, expected {len(joints)} joints, or 7 of the base before"
        )
    require_known("column", parts, known, f"{path}: ")
    has_base = not set(parts).isdisjoint(_BASE_COLUMNS)
    missing = [name for name in ((*_BASE_COLUMNS, *joints) if has_base else joints) if name not in parts]
    if missing or len(set(parts)) != table.shape[1]:
        raise InputError(f"{path}: lacks columns, or has one twice: {', '.join(missing or parts)}")
    if (fps is None) == ("time" not in parts):
        raise InputError(
            f"--fps: is {fps}, and {path} has {'a' if fps else 'no'} column 'time'; expected one of the two"
        )
    return SourceMotion(
        source=str(path),
        kind="csv",
        times=table[:, parts.index("time")] if fps is None else even_times(len(table), fps, "--fps"),
        joints=table[:, [parts.index(name) for name in joints]],
        joint_names=joints if has_names else None,
        base=table[:, [parts.index(name) for name in _BASE_COLUMNS]] if has_base else None,
        quaternion_order="wxyz" if has_names else None,
    )


def read_joint_states(path: Path, topic: str | None, joints: tuple[str, ...]) -> SourceMotion:
    """Read `sensor_msgs/msg/JointState` of one topic, from an MCAP file or a folder that rosbag2 wrote.

    Times are those of the headers, or of the recorder where the headers have none. Messages without any of the robot's
    joints are left out.
    """
    found: dict[str, list[tuple[float, list[float]]]] = {}
    with blaming(f"{path}: cannot be read as a recording (.mcap)", (OSError, McapError, CdrError, EOFError)):
        for name, time, position in _joint_states(sorted(path.glob("*.mcap")) if path.is_dir() else [path]):
            if topic in (None, name) and not position.keys().isdisjoint(joints):
                require_known("joint", joints, position, f"{path}: {name}: ")
                found.setdefault(name, []).append((time, [position[joint] for joint in joints]))
    if len(found) != 1:
        raise InputError(
            f"{path}: has {len(found)} topics of {JOINT_STATE} with the robot's joints"
            f"{f' called {topic}' if topic else ''}, expected one: {', '.join(found) or 'none'}; --topic chooses"
        )
    (rows,) = found.values()
    rows.sort()  # the files of a bag may come in any order
    return SourceMotion(
        source=str(path),
        kind="joint states",
        times=np.array([time for time, _ in rows]),
        joints=np.array([position for _, position in rows]),
        joint_names=joints,
        angle_unit="rad",
    )


def _joint_states(files: list[Path]) -> Iterator[tuple[str, float, dict[str, float]]]:
    """Yield topic, time in s and positions by joint of each message of this type."""
    for file in files:
        with regular_file(file, "an MCAP file", None).open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages():
                if schema is not None and schema.name == JOINT_STATE:
                    reader = CdrReader(message.data)
                    seconds, nanoseconds = reader.unpack("iI")
                    reader.string()
                    names, positions = reader.strings(), reader.array(np.float64).tolist()
                    time = seconds + 1e-9 * nanoseconds or 1e-9 * message.log_time
                    yield channel.topic, time, dict(zip(names, positions, strict=False))
