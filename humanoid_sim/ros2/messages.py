"""Encodes this package's types as the messages of `definitions`; `time_ns` is nanoseconds since the Unix epoch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import ControlMode, SafetyStatus, StandbyState
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, MITState
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, CdrReader, CdrWriter

_LAST_SECOND = 2**31 - 1  # `builtin_interfaces/Time` counts seconds in 32 bits
_UNKNOWN_COVARIANCE = np.zeros(9)  # as `sensor_msgs/Imu` defines
_WXYZ_TO_XYZW = [1, 2, 3, 0]
SESSION_FRAME = "humanoid_sim"
"""`frame_id` of a safety status that a session publishes: no session takes it for another program's."""


def _time(time_ns: int) -> tuple[int, int]:
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return min(seconds, _LAST_SECOND), nanoseconds


def _stamped(time_ns: int, frame: str | None = "") -> CdrWriter:
    """Return a message that begins with a header, or without a frame with a time stamp alone."""
    writer = CdrWriter()
    writer.pack("iI", *_time(time_ns))
    if frame is not None:
        writer.string(frame)
    return writer


@lru_cache(maxsize=64)
def _names(names: tuple[str, ...]) -> bytes:
    """Return an empty `frame_id` and names, as they follow a time stamp."""
    writer = CdrWriter()
    writer.string("")
    writer.strings(names)
    return writer.body()


def _named_arrays(time_ns: int, names: tuple[str, ...], *arrays: npt.NDArray[np.float64]) -> bytes:
    """Encode a header, names, and arrays with a number for each name."""
    writer = _stamped(time_ns, None)
    writer.append(_names(names))
    for values in arrays:
        writer.array(values)
    return writer.message()


def encode_clock(time_ns: int) -> bytes:
    """`rosgraph_msgs/msg/Clock`."""
    return _stamped(time_ns, None).message()


def encode_joint_state(time_ns: int, names: tuple[str, ...], state: MITState) -> bytes:
    """`sensor_msgs/msg/JointState`."""
    return _named_arrays(time_ns, names, state.joint_position, state.joint_velocity, state.joint_effort)


def encode_named_values(time_ns: int, names: tuple[str, ...], values: npt.NDArray[np.floating]) -> bytes:
    """`sensor_msgs/msg/JointState` with values (count,), one per name, as positions: tools plot this type by name."""
    none = np.zeros(0)
    return _named_arrays(time_ns, names, values.astype(np.float64), none, none)


def encode_mit_command(time_ns: int, names: tuple[str, ...], command: MITCommand) -> bytes:
    """`humanoid_control_msgs/msg/MITCommand`."""
    return _named_arrays(time_ns, names, *(getattr(command, name) for name in COMMAND_FIELDS))


def encode_pose(time_ns: int, frame: str, pose: FloatArray) -> bytes:
    """`geometry_msgs/msg/PoseStamped` of a pose (7,), m and w x y z, in a frame."""
    writer = _stamped(time_ns, frame)
    writer.fixed_array(np.concatenate([pose[:3], pose[3:][_WXYZ_TO_XYZW]]))
    return writer.message()


def encode_string(text: str) -> bytes:
    """`std_msgs/msg/String`."""
    writer = CdrWriter()
    writer.string(text)
    return writer.message()


class TransformEncoder:
    """`tf2_msgs/msg/TFMessage` of always the same frames, (parent, child): all but the numbers is laid out once."""

    def __init__(self, frames: Sequence[tuple[str, str]]) -> None:
        writer = CdrWriter()
        writer.pack("I", len(frames))
        stamps, numbers = [], []
        for parent, child in frames:
            writer.pack("iI", 0, 0)
            stamps.append(len(writer.body()) // 4 - 2)
            writer.string(parent)
            writer.string(child)
            writer.fixed_array(np.zeros(7))
            numbers.append(len(writer.body()) // 8 - 7)
        body = writer.body()
        self._size = len(body)
        self._body = np.frombuffer(body + bytes(-len(body) % 8), dtype=np.uint8).copy()
        self._stamps = np.array(stamps, dtype=np.intp)[:, None] + np.arange(2)
        self._numbers = np.array(numbers, dtype=np.intp)[:, None] + np.array([0, 1, 2, 6, 3, 4, 5])

    def encode(self, time_ns: int, poses: FloatArray) -> bytes:
        """Return the message of poses (count, 7), m and w x y z, of the children in their parents' frames."""
        self._body.view(np.uint32)[self._stamps] = _time(time_ns)
        self._body.view(np.float64)[self._numbers] = poses
        return ENCAPSULATION + self._body[: self._size].tobytes()


def encode_imu(time_ns: int, state: MITState) -> bytes:
    """`sensor_msgs/msg/Imu`: quaternion as x y z w, covariances unknown."""
    writer = _stamped(time_ns, "imu")
    quaternion = state.imu_quaternion[_WXYZ_TO_XYZW]
    for values in (quaternion, state.imu_angular_velocity, state.imu_linear_acceleration):
        writer.fixed_array(values)
        writer.fixed_array(_UNKNOWN_COVARIANCE)
    return writer.message()


def encode_control_mode(time_ns: int, control_mode: ControlMode) -> bytes:
    """`humanoid_control_msgs/msg/ControlMode`."""
    writer = _stamped(time_ns)
    writer.pack("B", control_mode.mode)
    writer.string(control_mode.controller_name)
    writer.string(control_mode.status_message)
    return writer.message()


def encode_standby_state(time_ns: int, standby: StandbyState) -> bytes:
    """`humanoid_control_msgs/msg/StandbyState`."""
    writer = _stamped(time_ns)
    writer.pack("IId?", standby.current_segment, standby.total_segments, standby.progress, standby.is_finished)
    return writer.message()


def encode_safety_status(time_ns: int, status: SafetyStatus) -> bytes:
    """`humanoid_control_msgs/msg/SafetyStatus`."""
    writer = _stamped(time_ns, SESSION_FRAME)
    writer.pack("B", status.level)
    writer.string(status.source)
    writer.pack("I", status.flags)
    writer.string(status.message)
    return writer.message()


class ForeignStatus(NamedTuple):
    """A safety status as it came."""

    frame: str
    level: int  # number of `SafetyLevel`, of any version, or beyond
    source: str
    flags: int
    message: str


def decode_safety_status(message: bytes) -> ForeignStatus:
    """Return a `humanoid_control_msgs/msg/SafetyStatus`. Raises `CdrError`."""
    reader = CdrReader(message)
    reader.unpack("iI")
    frame, level, source = reader.string(), *reader.unpack("B"), reader.string()
    flags, text = *reader.unpack("I"), reader.string()
    reader.finish()
    return ForeignStatus(frame, level, source, flags, text)


def encode_float32_array(values: npt.NDArray[np.float32]) -> bytes:
    """`std_msgs/msg/Float32MultiArray`: the values, no dimensions."""
    writer = CdrWriter()
    writer.pack("II", 0, 0)
    writer.array(np.asarray(values, dtype=np.float32))
    return writer.message()


def decode_float32_array(message: bytes) -> npt.NDArray[np.float32]:
    """Return the flat values of a `std_msgs/msg/Float32MultiArray`. Shape (count,). Raises `CdrError`."""
    reader = CdrReader(message)
    for _ in range(reader.count(13)):
        reader.string()
        reader.unpack("II")
    (offset,) = reader.unpack("I")
    values: npt.NDArray[np.float32] = reader.array(np.float32)
    reader.finish()
    if offset > len(values):
        raise CdrError(f"data_offset {offset} in an array of {len(values)}")
    return values[offset:]


def decode_mit_command(message: bytes) -> tuple[tuple[str, ...], MITCommand]:
    """Return the joint names and the fields, each of shape (n,), of a `humanoid_control_msgs/msg/MITCommand`.

    Its stamp is the sender's clock, which means nothing here. Raises `CdrError` if it is none, `FieldError` if its
    fields are not equally long.
    """
    reader = CdrReader(message)
    reader.unpack("iI")
    reader.string()
    names = reader.strings()
    fields = [reader.array(np.float64) for _ in COMMAND_FIELDS]
    reader.finish()
    return names, MITCommand(*fields)
