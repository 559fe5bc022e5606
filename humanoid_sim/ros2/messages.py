"""Encodes this package's types as the ROS 2 messages of `schemas`; `time_ns` is nanoseconds since the Unix epoch."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import ControlMode, SafetyStatus, StandbyState
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, CdrReader, CdrWriter

_IMU_FRAME = struct.pack("<I4s", 4, b"imu")
"""As CDR's string: its length, the bytes and a NUL."""
_STAMP = struct.Struct("<iI")
_LAST_SECOND = 2**31 - 1
"""`builtin_interfaces/Time` counts seconds in 32 bits."""
_UNKNOWN_COVARIANCE = bytes(9 * 8)
"""Covariance that `sensor_msgs/Imu` defines to mean "unknown"."""
_COUNT = struct.Struct("<I4x")
"""Count of an array of float64 that follows another: it stands on a multiple of 8, and so does the array."""
_NO_COUNT = bytes(4)
_NO_VELOCITY_NO_EFFORT = bytes(8)


@lru_cache(maxsize=4)
def _stamp(time_ns: int) -> bytes:
    """Return a time stamp at the start of a message; 8 bytes, so that what follows stands on a multiple of 8."""
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return _STAMP.pack(min(seconds, _LAST_SECOND), nanoseconds)


def _stamped(time_ns: int) -> CdrWriter:
    """Return a message that begins with a time stamp."""
    writer = CdrWriter()
    writer.append(_stamp(time_ns))
    return writer


@lru_cache(maxsize=128)
def _names_and_counts(names: tuple[str, ...]) -> tuple[bytes, bytes]:
    """Say what is the same in every message of a run, up to the numbers: an empty `frame_id`, the joint names, a count.

    And the count of each further array of as many numbers.
    """
    writer = CdrWriter()
    writer.string("")
    writer.strings(names)
    writer.pack("I", len(names))
    body = writer.body()
    return (body + bytes(-len(body) % 8), _COUNT.pack(len(names))) if names else (body, _NO_COUNT)


def _named_arrays(time_ns: int, names: tuple[str, ...], *arrays: npt.NDArray[np.float64]) -> bytes:
    """Encode a header, names, and arrays with a number for each name. Those below go out 50 times a second."""
    head, count = _names_and_counts(names)
    first, *others = (values.tobytes() for values in arrays)
    return b"".join((ENCAPSULATION, _stamp(time_ns), head, first, *(part for own in others for part in (count, own))))


def encode_clock(time_ns: int) -> bytes:
    """`rosgraph_msgs/msg/Clock`."""
    return _stamped(time_ns).message()


def encode_joint_state(time_ns: int, names: tuple[str, ...], state: MITState) -> bytes:
    """`sensor_msgs/msg/JointState`."""
    return _named_arrays(time_ns, names, state.joint_position, state.joint_velocity, state.joint_effort)


def encode_named_values(time_ns: int, names: tuple[str, ...], values: npt.NDArray[np.floating]) -> bytes:
    """`sensor_msgs/msg/JointState` with values (count,), one per name, as positions: tools plot this type by name."""
    return _named_arrays(time_ns, names, values.astype(np.float64, copy=False)) + _NO_VELOCITY_NO_EFFORT


def encode_pose(time_ns: int, frame: str, pose: FloatArray) -> bytes:
    """`geometry_msgs/msg/PoseStamped` of a pose (7,), m and w x y z, in a frame."""
    x, y, z, qw, qx, qy, qz = pose
    writer = _stamped(time_ns)
    writer.string(frame)
    writer.pack("ddddddd", x, y, z, qx, qy, qz, qw)
    return writer.message()


def encode_string(text: str) -> bytes:
    """`std_msgs/msg/String`."""
    writer = CdrWriter()
    writer.string(text)
    return writer.message()


class TransformEncoder:
    """`tf2_msgs/msg/TFMessage` of always the same frames: all but the numbers is laid out once."""

    def __init__(self, frames: Sequence[tuple[str, str]]) -> None:
        """Lay the message out, for the parent and child of each transform."""
        writer = CdrWriter()
        writer.pack("I", len(frames))
        stamps: list[int] = []
        numbers: list[int] = []
        for parent, child in frames:
            writer.pack("iI", 0, 0)
            stamps.append(len(writer.body()) // 4 - 2)
            writer.string(parent)
            writer.string(child)
            writer.pack("ddddddd", *[0.0] * 7)
            numbers.append(len(writer.body()) // 8 - 7)
        self._size = len(writer.body())
        self._body = np.zeros(-(-self._size // 8) * 8, dtype=np.uint8)
        self._body[: self._size] = np.frombuffer(writer.body(), dtype=np.uint8)
        self._words, self._doubles = self._body.view(np.uint32), self._body.view(np.float64)
        self._seconds = np.array(stamps, dtype=np.intp)
        self._nanoseconds = self._seconds + 1
        self._numbers = np.array(numbers, dtype=np.intp)[:, None] + np.array([0, 1, 2, 6, 3, 4, 5])

    def encode(self, time_ns: int, poses: FloatArray) -> bytes:
        """Return the message of poses (count, 7), m and w x y z, of the children in their parents' frames."""
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        self._words[self._seconds] = min(seconds, _LAST_SECOND)
        self._words[self._nanoseconds] = nanoseconds
        self._doubles[self._numbers] = poses
        return ENCAPSULATION + self._body[: self._size].tobytes()


def encode_imu(time_ns: int, state: MITState) -> bytes:
    """`sensor_msgs/msg/Imu`: quaternion as x y z w, covariances unknown."""
    wxyz, covariance = state.imu_quaternion.tobytes(), _UNKNOWN_COVARIANCE
    orientation = (wxyz[8:], wxyz[:8], covariance)
    turning = (state.imu_angular_velocity.tobytes(), covariance)
    acceleration = (state.imu_linear_acceleration.tobytes(), covariance)
    return b"".join((ENCAPSULATION, _stamp(time_ns), _IMU_FRAME, *orientation, *turning, *acceleration))


def encode_mit_command(time_ns: int, names: tuple[str, ...], command: MITCommand) -> bytes:
    """`humanoid_control_msgs/msg/MITCommand`."""
    return _named_arrays(
        time_ns, names, command.position, command.velocity, command.effort, command.stiffness, command.damping
    )


@lru_cache(maxsize=16)
def _control_mode(mode: int, controller_name: str, status_message: str) -> bytes:
    """Return the same in many ticks: all but the time stamp."""
    writer = CdrWriter()
    writer.string("")
    writer.pack("B", mode)
    writer.string(controller_name)
    writer.string(status_message)
    return writer.body()


def encode_control_mode(time_ns: int, control_mode: ControlMode) -> bytes:
    """`humanoid_control_msgs/msg/ControlMode`."""
    body = _control_mode(control_mode.mode, control_mode.controller_name, control_mode.status_message)
    return b"".join((ENCAPSULATION, _stamp(time_ns), body))


def encode_standby_state(time_ns: int, standby: StandbyState) -> bytes:
    """`humanoid_control_msgs/msg/StandbyState`."""
    writer = _stamped(time_ns)
    writer.string("")
    writer.pack("IId?", standby.current_segment, standby.total_segments, standby.progress, standby.is_finished)
    return writer.message()


SESSION_FRAME = "humanoid_sim"
"""`frame_id` of a safety status that a session publishes: no session takes it for another program's."""


def encode_safety_status(time_ns: int, status: SafetyStatus) -> bytes:
    """`humanoid_control_msgs/msg/SafetyStatus`."""
    writer = _stamped(time_ns)
    writer.string(SESSION_FRAME)
    writer.pack("B", status.level)
    writer.string(status.source)
    writer.pack("I", status.flags)
    writer.string(status.message)
    return writer.message()


class ForeignStatus(NamedTuple):
    """A safety status as it came."""

    frame: str
    level: int
    """Number of `SafetyLevel`, of any version, or beyond."""
    source: str
    flags: int
    message: str


def decode_safety_status(message: bytes) -> ForeignStatus:
    """Return a `humanoid_control_msgs/msg/SafetyStatus`. Raises `CdrError`."""
    reader = CdrReader(message)
    reader.unpack("iI")
    frame = reader.string()
    (level,) = reader.unpack("B")
    source = reader.string()
    (flags,) = reader.unpack("I")
    text = reader.string()
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

    Its stamp is the sender's clock, which means nothing here.

    Raises:
        CdrError: it is none.
        FieldError: its fields are not equally long.
    """
    reader = CdrReader(message)
    reader.unpack("iI")
    reader.string()
    names = reader.strings()
    fields = [reader.array(np.float64) for _ in range(5)]
    reader.finish()
    return names, MITCommand(*fields)
