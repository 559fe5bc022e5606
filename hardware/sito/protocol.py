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

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.robots.motors import SITO_COUNTS_PER_RAD, MotorModel


class MessageType(IntEnum):
    """The lowest byte of an identifier."""

    RESET = 0x00
    SELECT_MODE = 0x01
    COMMAND = 0x09
    GAINS = 0x45
    FEEDBACK_0 = 0xB0
    FEEDBACK_1 = 0xB1
    FEEDBACK_2 = 0xB2
    FEEDBACK_3 = 0xB3


class Mode(IntEnum):
    """Modes that a motor can be set to."""

    POSITION = 0x08
    MIT = 0x09  # selecting it enables the motor


FROM_MOTOR = frozenset(kind for kind in MessageType if kind >= MessageType.FEEDBACK_0)  # all others are a host's
LARGEST_INTERVAL = 255  # ms between two frames of one kind of feedback
_PREFIX = 0x0506
_RESET = b"\x55" * 8
_STIFFNESS_UNIT = 500.0
"""N·m/rad in a gain of 1. Another page of the same authors has 688.58, measured: see `MotorFamily.stiffness_doubt`."""
_DAMPING_UNIT = 0.5  # N·m·s/rad in a gain of 1; 1.125 there
_CURRENT_STEPS = 2**15 - 1
_COMMAND, _GAINS = struct.Struct(">hhi"), struct.Struct(">ff")
_FEEDBACK_1, _FEEDBACK_2 = struct.Struct(">xxhxxh"), struct.Struct(">xxxxi")  # other bytes are not known


class Message(msgspec.Struct, frozen=True):
    """A message to or from one motor; values in rad, s and N·m, motor frame."""

    device_id: int


class Reset(Message, frozen=True):
    """Disable: the motor goes limp."""


class SelectMode(Message, frozen=True):
    """Selecting MIT enables."""

    mode: Mode
    intervals: tuple[int, int, int]  # ms, of feedback 1, 2 and 3; 0: none


class Gains(Message, frozen=True):
    """K_p and K_d of the MIT law; they hold until others are sent."""

    stiffness: float
    damping: float


class Command(Message, frozen=True):
    """The other three fields of the MIT law."""

    position: float
    velocity: float
    effort: float


class Feedback(Message, frozen=True):
    """Feedback 1."""

    velocity: float  # not beyond ±3.14
    effort: float  # from the current


class PositionFeedback(Message, frozen=True):
    """Feedback 2."""

    position: float  # of the output


class Malformed(Message, frozen=True):
    """A frame with a Sito identifier that cannot be read."""

    reason: str


HostMessage: TypeAlias = Reset | SelectMode | Gains | Command
MotorMessage: TypeAlias = Feedback | PositionFeedback


def split_identifier(frame: Frame) -> tuple[int, int] | None:
    """Return device id and message type of a frame with a Sito identifier; None for any other frame."""
    if not frame.is_extended or frame.is_remote or frame.is_error or frame.arbitration_id >> 16 != _PREFIX:
        return None
    return frame.arbitration_id >> 8 & 0xFF, frame.arbitration_id & 0xFF


def encode(message: HostMessage | MotorMessage, model: MotorModel) -> Frame:
    """Return the frame of a message, unknown bytes zero. A value that does not fit raises; it is never wrapped."""
    match message:
        case Reset():
            kind, data = MessageType.RESET, _RESET
        case SelectMode(mode=mode, intervals=intervals):
            kind, data = MessageType.SELECT_MODE, bytes([mode, *intervals]).ljust(8, b"\0")
        case Gains(stiffness=stiffness, damping=damping):
            kind, data = MessageType.GAINS, _GAINS.pack(stiffness / _STIFFNESS_UNIT, damping / _DAMPING_UNIT)
        case Command(position=position, velocity=velocity, effort=effort):
            counts = _current(effort, model), _counts(velocity), _counts(position)
            kind, data = MessageType.COMMAND, _COMMAND.pack(*counts)
        case Feedback(velocity=velocity, effort=effort):
            kind, data = MessageType.FEEDBACK_1, _FEEDBACK_1.pack(_current(effort, model), _counts(velocity))
        case PositionFeedback(position=position):
            kind, data = MessageType.FEEDBACK_2, _FEEDBACK_2.pack(_counts(position))
    return Frame(_PREFIX << 16 | message.device_id << 8 | kind, data)


def _current(effort: float, model: MotorModel) -> int:
    return _rounded(effort * (_CURRENT_STEPS / model.effort))


def _counts(angle: float) -> int:
    return _rounded(angle * SITO_COUNTS_PER_RAD)


def _rounded(value: float) -> int:
    """Return the nearest whole number; a half goes away from zero."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def decode(  # noqa: PLR0911 - one for each message
    frame: Frame, model: MotorModel
) -> HostMessage | MotorMessage | Malformed | None:
    """Return the message of a frame from or to a motor of this model; never raises. None: not one of these types."""
    parts = split_identifier(frame)
    if parts is None or parts[1] not in set(MessageType) - {MessageType.FEEDBACK_0, MessageType.FEEDBACK_3}:
        return None
    (device_id, kind), data, effort_unit = parts, frame.data, model.effort / _CURRENT_STEPS
    malformed = Malformed(device_id, f"{MessageType(kind).name.lower().replace('_', ' ')} with data '{data.hex(' ')}'")
    if len(data) != 8:
        return malformed
    match kind:
        case MessageType.RESET:
            return Reset(device_id) if data == _RESET else malformed
        case MessageType.SELECT_MODE:
            is_known = data[0] in tuple(Mode)
            return SelectMode(device_id, Mode(data[0]), (data[1], data[2], data[3])) if is_known else malformed
        case MessageType.GAINS:
            stiffness, damping = _GAINS.unpack(data)
            is_sound = 0.0 <= stiffness < math.inf and 0.0 <= damping < math.inf  # NaN is not
            return Gains(device_id, stiffness * _STIFFNESS_UNIT, damping * _DAMPING_UNIT) if is_sound else malformed
        case MessageType.COMMAND:
            current, velocity, position = _COMMAND.unpack(data)
            angles = position / SITO_COUNTS_PER_RAD, velocity / SITO_COUNTS_PER_RAD
            return Command(device_id, *angles, current * effort_unit)
        case MessageType.FEEDBACK_1:
            current, velocity = _FEEDBACK_1.unpack(data)
            return Feedback(device_id, velocity / SITO_COUNTS_PER_RAD, current * effort_unit)
    return PositionFeedback(device_id, _FEEDBACK_2.unpack(data)[0] / SITO_COUNTS_PER_RAD)


def damping_frames(device_id: int, model: MotorModel, damping: float, position: float = 0.0) -> tuple[Frame, ...]:
    """Return the frames that only brake a motor, N·m·s/rad: gains twice, as none is acknowledged, then the command."""
    gains = encode(Gains(device_id, 0.0, min(damping, model.damping)), model)
    return gains, gains, encode(Command(device_id, position, 0.0, 0.0), model)


def reset_frames(device_id: int, model: MotorModel) -> tuple[Frame, ...]:
    """Return the frames that disable a motor: limp first, in case it does not obey the reset."""
    return *damping_frames(device_id, model, 0.0), encode(Reset(device_id), model)
