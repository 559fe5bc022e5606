"""Messages of Sito motors (TA40-50, TA40-100) to frames, and back, for both ends of the bus.

Extended frames of 8 bytes, big-endian; the identifier is `0x0506 << 16 | device_id << 8 | message type`. Positions are
int32 and velocities int16 in counts of the output's angle, 65536 a turn; efforts are an int16 current; a gain is a
float32 in units of its own.

Source: Actuator-Control (T-K-233 and Berkeley-Humanoids, commit d74dd3f), `src/protocol/sito.rs` and `src/sito.rs`.
There is no public manual: feedback 0 and 3, fault codes, a timeout in the motor and a torque limit are not known.
"""

from __future__ import annotations

import math
import struct
from enum import IntEnum
from typing import TypeAlias

import msgspec

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.robots.motors import SITO_COUNTS_PER_RAD, MotorModel


class MessageType(IntEnum):
    """The lowest byte of an identifier; from 0xB0 on a motor's, all others a host's."""

    RESET = 0x00
    SELECT_MODE = 0x01
    COMMAND = 0x09
    GAINS = 0x45
    FEEDBACK_1 = 0xB1
    FEEDBACK_2 = 0xB2


LARGEST_INTERVAL = 255  # ms between two frames of one kind of feedback
_PREFIX = 0x0506
_MIT = 0x09  # the mode whose selection enables a motor
_RESET = b"\x55" * 8
_STIFFNESS_UNIT = 500.0
"""N·m/rad in a gain of 1. Another page of the same authors has 688.58, measured: see `MotorFamily.stiffness_doubt`."""
_DAMPING_UNIT = 0.5  # N·m·s/rad in a gain of 1; 1.125 there
_CURRENT_STEPS = 2**15 - 1
_COMMAND, _GAINS = struct.Struct(">hhi"), struct.Struct(">ff")
_FEEDBACK_1, _FEEDBACK_2 = struct.Struct(">xxhxxh"), struct.Struct(">xxxxi")  # other bytes are not known


class _Message(msgspec.Struct, frozen=True):
    device_id: int


class Reset(_Message, frozen=True):
    """Disable: the motor goes limp."""


class Enable(_Message, frozen=True):
    """Select MIT mode, which enables, and both kinds of feedback."""

    interval: int  # ms between two frames of one kind; 0: none


class Gains(_Message, frozen=True):
    """K_p and K_d of the MIT law; they hold until others are sent."""

    stiffness: float
    damping: float


class Command(_Message, frozen=True):
    """The other three fields of the MIT law, in rad, s and N·m, motor frame."""

    position: float
    velocity: float
    effort: float


class Feedback(_Message, frozen=True):
    """Feedback 1, in rad/s and N·m, motor frame."""

    velocity: float  # not beyond ±3.14
    effort: float  # from the current


class PositionFeedback(_Message, frozen=True):
    """Feedback 2, rad, motor frame."""

    position: float  # of the output


HostMessage: TypeAlias = Reset | Enable | Gains | Command
MotorMessage: TypeAlias = Feedback | PositionFeedback


def split_identifier(frame: Frame) -> tuple[int, int] | None:
    """Return device id and message type of a frame with a Sito identifier; None for any other frame."""
    if not frame.is_extended or frame.is_remote or frame.is_error or frame.arbitration_id >> 16 != _PREFIX:
        return None
    return frame.arbitration_id >> 8 & 0xFF, frame.arbitration_id & 0xFF


def encode(message: HostMessage | MotorMessage, model: MotorModel) -> Frame:
    """Return the frame of a message, unknown bytes zero. A value that does not fit raises; it is never wrapped."""
    steps = _CURRENT_STEPS / model.effort
    match message:
        case Reset():
            kind, data = MessageType.RESET, _RESET
        case Enable(interval=interval):
            kind, data = MessageType.SELECT_MODE, bytes([_MIT, interval, interval, 0, 0, 0, 0, 0])
        case Gains(stiffness=stiffness, damping=damping):
            kind, data = MessageType.GAINS, _GAINS.pack(stiffness / _STIFFNESS_UNIT, damping / _DAMPING_UNIT)
        case Command(position=position, velocity=velocity, effort=effort):
            counts = _rounded(effort * steps), _counts(velocity), _counts(position)
            kind, data = MessageType.COMMAND, _COMMAND.pack(*counts)
        case Feedback(velocity=velocity, effort=effort):
            data = _FEEDBACK_1.pack(_rounded(effort * steps), _counts(velocity))
            kind = MessageType.FEEDBACK_1
        case PositionFeedback(position=position):
            kind, data = MessageType.FEEDBACK_2, _FEEDBACK_2.pack(_counts(position))
    return Frame(_PREFIX << 16 | message.device_id << 8 | kind, data)


def _counts(angle: float) -> int:
    return _rounded(angle * SITO_COUNTS_PER_RAD)


def _rounded(value: float) -> int:
    """Return the nearest whole number; a half goes away from zero."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def decode(frame: Frame, model: MotorModel) -> HostMessage | MotorMessage | None:  # noqa: PLR0911 - one for each
    """Return the message of a frame from or to a motor of this model; never raises. None: it cannot be read."""
    parts, data = split_identifier(frame), frame.data
    if parts is None or len(data) != 8:
        return None
    (device_id, kind), current_unit = parts, model.effort / _CURRENT_STEPS
    match kind:
        case MessageType.RESET if data == _RESET:
            return Reset(device_id)
        case MessageType.SELECT_MODE if data[0] == _MIT:
            return Enable(device_id, data[1])
        case MessageType.GAINS:
            stiffness, damping = _GAINS.unpack(data)
            if 0.0 <= stiffness < math.inf and 0.0 <= damping < math.inf:  # NaN is not
                return Gains(device_id, stiffness * _STIFFNESS_UNIT, damping * _DAMPING_UNIT)
        case MessageType.COMMAND:
            current, velocity, position = _COMMAND.unpack(data)
            angles = position / SITO_COUNTS_PER_RAD, velocity / SITO_COUNTS_PER_RAD
            return Command(device_id, *angles, current * current_unit)
        case MessageType.FEEDBACK_1:
            current, velocity = _FEEDBACK_1.unpack(data)
            return Feedback(device_id, velocity / SITO_COUNTS_PER_RAD, current * current_unit)
        case MessageType.FEEDBACK_2:
            return PositionFeedback(device_id, _FEEDBACK_2.unpack(data)[0] / SITO_COUNTS_PER_RAD)
    return None


def damping_frames(device_id: int, model: MotorModel, damping: float, position: float = 0.0) -> tuple[Frame, ...]:
    """Return the frames that only brake a motor, N·m·s/rad: gains twice, as none is acknowledged, then the command."""
    gains = encode(Gains(device_id, 0.0, min(damping, model.damping)), model)
    return gains, gains, encode(Command(device_id, position, 0.0, 0.0), model)


def reset_frames(device_id: int, model: MotorModel) -> tuple[Frame, ...]:
    """Return the frames that disable a motor: limp first, in case it does not obey the reset."""
    return *damping_frames(device_id, model, 0.0), encode(Reset(device_id), model)
