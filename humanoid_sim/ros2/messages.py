"""Encodes this package's types as the ROS 2 messages of `schemas`; `time_ns` is nanoseconds since the Unix epoch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import ControlMode, SafetyStatus, StandbyState
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, CdrReader, CdrWriter

__all__ = [
    "TransformEncoder",
    "decode_float32_array",
    "encode_control_mode",
    "encode_float32_array",
    "encode_imu",
    "encode_joint_state",
    "encode_mit_command",
    "encode_named_values",
    "encode_pose",
    "encode_safety_status",
    "encode_standby_state",
    "encode_string",
]

_IMU_FRAME = "imu"
_LAST_SECOND = 2**31 - 1
"""`builtin_interfaces/Time` counts seconds in 32 bits."""
_UNKNOWN_COVARIANCE = np.zeros(9)
"""What `sensor_msgs/Imu` defines to mean "unknown"."""


def _stamped(time_ns: int) -> CdrWriter:
    """A message that begins with a time stamp; 8 bytes, so that what follows stands on a multiple of 8."""
    writer = CdrWriter()
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    writer.pack("iI", min(seconds, _LAST_SECOND), nanoseconds)
    return writer


@lru_cache(maxsize=128)
def _frame_and_names(names: tuple[str, ...]) -> bytes:
    """An empty `frame_id` and the joint names: the same in every message of a run."""
    writer = CdrWriter()
    writer.string("")
    writer.strings(names)
    return writer.body()


def encode_joint_state(time_ns: int, names: tuple[str, ...], state: MITState) -> bytes:
    """`sensor_msgs/msg/JointState`."""
    writer = _stamped(time_ns)
    writer.append(_frame_and_names(names))
    for values in (state.joint_position, state.joint_velocity, state.joint_effort):
        writer.array(values)
    return writer.message()


def encode_named_values(time_ns: int, names: tuple[str, ...], values: npt.NDArray[np.floating]) -> bytes:
    """`sensor_msgs/msg/JointState` with any values (count,) as positions: the type whose names tools plot."""
    writer = _stamped(time_ns)
    writer.append(_frame_and_names(names))
    writer.array(np.asarray(values, dtype=np.float64))
    writer.pack("II", 0, 0)
    return writer.message()


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
        """Lay the message out.

        Args:
            frames: parent and child of each transform.
        """
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
        self._stamps = np.array(stamps, dtype=np.intp)
        self._numbers = np.array(numbers, dtype=np.intp)[:, None] + np.array([0, 1, 2, 6, 3, 4, 5])

    def encode(self, time_ns: int, poses: FloatArray) -> bytes:
        """The message of poses (count, 7), m and w x y z, of the children in their parents' frames."""
        seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
        stamps = self._body.view(np.uint32)
        stamps[self._stamps] = min(seconds, _LAST_SECOND)
        stamps[self._stamps + 1] = nanoseconds
        self._body.view(np.float64)[self._numbers] = poses
        return ENCAPSULATION + self._body[: self._size].tobytes()


def encode_imu(time_ns: int, state: MITState) -> bytes:
    """`sensor_msgs/msg/Imu`: quaternion as x y z w, covariances unknown."""
    w, x, y, z = state.imu_quaternion
    writer = _stamped(time_ns)
    writer.string(_IMU_FRAME)
    writer.pack("dddd", x, y, z, w)
    writer.fixed_array(_UNKNOWN_COVARIANCE)
    writer.fixed_array(state.imu_angular_velocity)
    writer.fixed_array(_UNKNOWN_COVARIANCE)
    writer.fixed_array(state.imu_linear_acceleration)
    writer.fixed_array(_UNKNOWN_COVARIANCE)
    return writer.message()


def encode_mit_command(time_ns: int, names: tuple[str, ...], command: MITCommand) -> bytes:
    """`humanoid_control_msgs/msg/MITCommand`."""
    writer = _stamped(time_ns)
    writer.append(_frame_and_names(names))
    for values in (command.position, command.velocity, command.effort, command.stiffness, command.damping):
        writer.array(values)
    return writer.message()


def encode_control_mode(time_ns: int, control_mode: ControlMode) -> bytes:
    """`humanoid_control_msgs/msg/ControlMode`."""
    writer = _stamped(time_ns)
    writer.string("")
    writer.pack("B", control_mode.mode)
    writer.string(control_mode.controller_name)
    writer.string(control_mode.status_message)
    return writer.message()


def encode_standby_state(time_ns: int, standby: StandbyState) -> bytes:
    """`humanoid_control_msgs/msg/StandbyState`."""
    writer = _stamped(time_ns)
    writer.string("")
    writer.pack("IId?", standby.current_segment, standby.total_segments, standby.progress, standby.is_finished)
    return writer.message()


def encode_safety_status(time_ns: int, status: SafetyStatus) -> bytes:
    """`humanoid_control_msgs/msg/SafetyStatus`."""
    writer = _stamped(time_ns)
    writer.string("")
    writer.pack("B", status.level)
    writer.string(status.source)
    writer.pack("I", status.flags)
    writer.string(status.message)
    return writer.message()


def encode_float32_array(values: npt.NDArray[np.float32]) -> bytes:
    """`std_msgs/msg/Float32MultiArray`: the values, no dimensions."""
    writer = CdrWriter()
    writer.pack("II", 0, 0)
    writer.array(np.asarray(values, dtype=np.float32))
    return writer.message()


def decode_float32_array(message: bytes) -> npt.NDArray[np.float32]:
    """The flat values of a `std_msgs/msg/Float32MultiArray`. Shape (count,). Raises `CdrError`."""
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
