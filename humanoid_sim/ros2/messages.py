"""Encodes this package's types as the messages of `definitions`; `time_ns` is nanoseconds since the Unix epoch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import ControlMode, SafetyFlag, SafetyLevel, SafetyStatus, StandbyState
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, MITState
from humanoid_sim.ros2.cdr import ENCAPSULATION, CdrError, decode, encode
from humanoid_sim.ros2.definitions import (
    CONTROL_MODE,
    FLOAT32_MULTI_ARRAY,
    IMU,
    JOINT_STATE,
    MIT_COMMAND,
    SAFETY_STATUS,
    STANDBY_STATE,
    TF_MESSAGE,
)

_Values = Sequence[float] | npt.NDArray[np.floating]
_LAST_SECOND = 2**31 - 1  # `builtin_interfaces/Time` counts seconds in 32 bits
_UNKNOWN = (0.0,) * 9  # covariance, as `sensor_msgs/Imu` defines
_POSE_TO_XYZW = [0, 1, 2, 4, 5, 6, 3]
_BLANK = 0x5EED5EED  # a number whose bytes are in no name
SESSION_FRAME = "humanoid_sim"
"""`frame_id` of a safety status that a session publishes: no session takes it for another program's."""


def stamp(time_ns: int) -> tuple[int, int]:
    """`builtin_interfaces/msg/Time`."""
    seconds, nanoseconds = divmod(time_ns, 1_000_000_000)
    return min(seconds, _LAST_SECOND), nanoseconds


def time_ns(stamp: tuple[int, int]) -> int:
    """Return nanoseconds since the Unix epoch of a `builtin_interfaces/msg/Time`."""
    seconds, nanoseconds = stamp
    return seconds * 1_000_000_000 + nanoseconds


def encode_joint_state(
    time_ns: int, names: Sequence[str], position: _Values, velocity: _Values = (), effort: _Values = ()
) -> bytes:
    """`sensor_msgs/msg/JointState`; positions alone of what tools shall plot by name."""
    return encode(JOINT_STATE, stamp(time_ns), "", names, position, velocity, effort)


def encode_mit_command(time_ns: int, names: tuple[str, ...], command: MITCommand) -> bytes:
    """`humanoid_control_msgs/msg/MITCommand`."""
    fields = (getattr(command, name) for name in COMMAND_FIELDS)
    return encode(MIT_COMMAND, stamp(time_ns), "", names, *fields)


class TransformEncoder:
    """`tf2_msgs/msg/TFMessage` of always the same frames, (parent, child): encoded once, then only numbers change."""

    def __init__(self, frames: Sequence[tuple[str, str]]) -> None:
        blank = encode(TF_MESSAGE, [((_BLANK, _BLANK), *frame, (float(_BLANK),) * 7) for frame in frames])
        body = blank.removeprefix(ENCAPSULATION)
        self._size = len(body)
        self._body = np.frombuffer(body + bytes(-len(body) % 8), dtype=np.uint8).copy()
        self._stamps = np.flatnonzero(self._body.view(np.uint32) == _BLANK).reshape(-1, 2)
        self._numbers = np.flatnonzero(self._body.view(np.float64) == _BLANK).reshape(-1, 7)

    def encode(self, time_ns: int, poses: FloatArray) -> bytes:
        """Return the message of poses (count, 7), m and w x y z, of the children in their parents' frames."""
        self._body.view(np.uint32)[self._stamps] = stamp(time_ns)
        self._body.view(np.float64)[self._numbers] = poses[:, _POSE_TO_XYZW]
        return ENCAPSULATION + self._body[: self._size].tobytes()


def encode_imu(time_ns: int, state: MITState) -> bytes:
    """`sensor_msgs/msg/Imu`: quaternion as x y z w, covariances unknown."""
    w, x, y, z = state.imu_quaternion.tolist()
    velocity, acceleration = state.imu_angular_velocity.tolist(), state.imu_linear_acceleration.tolist()
    numbers = x, y, z, w, *_UNKNOWN, *velocity, *_UNKNOWN, *acceleration, *_UNKNOWN
    return encode(IMU, stamp(time_ns), "imu", numbers)


def encode_control_mode(time_ns: int, control_mode: ControlMode) -> bytes:
    """`humanoid_control_msgs/msg/ControlMode`."""
    texts = control_mode.controller_name, control_mode.status_message
    return encode(CONTROL_MODE, stamp(time_ns), "", (control_mode.mode,), *texts)


def encode_standby_state(time_ns: int, standby: StandbyState) -> bytes:
    """`humanoid_control_msgs/msg/StandbyState`."""
    values = standby.current_segment, standby.total_segments, standby.progress, standby.is_finished
    return encode(STANDBY_STATE, stamp(time_ns), "", values)


def encode_safety_status(time_ns: int, status: SafetyStatus) -> bytes:
    """`humanoid_control_msgs/msg/SafetyStatus`."""
    values = (status.level,), status.source, (status.flags,), status.message
    return encode(SAFETY_STATUS, stamp(time_ns), SESSION_FRAME, *values)


def decode_safety_status(message: bytes) -> tuple[str, SafetyStatus]:
    """Return the frame and the status of a `SafetyStatus`; a level beyond CRITICAL is CRITICAL. Raises `CdrError`."""
    _, frame, (level,), source, (flags,), text = decode(SAFETY_STATUS, message)
    return frame, SafetyStatus(SafetyLevel(min(level, SafetyLevel.CRITICAL)), SafetyFlag(flags), source, text)


def encode_float32_array(values: npt.NDArray[np.floating]) -> bytes:
    """`std_msgs/msg/Float32MultiArray`: the values, no dimensions."""
    return encode(FLOAT32_MULTI_ARRAY, [], (0,), values)


def decode_float32_array(message: bytes) -> npt.NDArray[np.float32]:
    """Return the flat values of a `std_msgs/msg/Float32MultiArray`. Shape (count,). Raises `CdrError`."""
    _, (offset,), values = decode(FLOAT32_MULTI_ARRAY, message)
    if offset > len(values):
        raise CdrError(f"data_offset {offset} in an array of {len(values)}")
    found: npt.NDArray[np.float32] = values[offset:]
    return found
