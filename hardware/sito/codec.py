"""Messages of Sito motors to frames, and back: extended frames of 8 bytes, all numbers big-endian.

An identifier is `0x0506 << 16 | device_id << 8 | message type`. Positions are int32 and velocities int16 in counts of
the output's angle, 65536 a turn; efforts are an int16 current. A gain is a float32, in units of its own.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

import numpy as np

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motor_link import MotorGroup
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import SITO_COUNTS_PER_RAD, MotorModel


class MessageType(IntEnum):
    """The lowest byte of an identifier."""

    RESET = 0x00
    SELECT_MODE = 0x01
    COMMAND = 0x09
    GAINS = 0x45
    FEEDBACK_0 = 0xB0
    """Named by the library, and never used: what it holds is not known."""
    FEEDBACK_1 = 0xB1
    FEEDBACK_2 = 0xB2
    FEEDBACK_3 = 0xB3
    """Likewise."""


FROM_MOTOR = frozenset({MessageType.FEEDBACK_0, MessageType.FEEDBACK_1, MessageType.FEEDBACK_2, MessageType.FEEDBACK_3})
"""Messages that motors send; all others are a host's."""
_DECODED = frozenset(MessageType) - {MessageType.FEEDBACK_0, MessageType.FEEDBACK_3}


class Mode(IntEnum):
    """Modes that a motor can be set to."""

    POSITION = 0x08
    MIT = 0x09
    """Selecting it enables the motor."""


LARGEST_DEVICE_ID = 255
LARGEST_INTERVAL = 255
"""ms between two frames of one kind of feedback."""
_PREFIX = 0x0506
_RESET = b"\x55" * 8
_LENGTH = 8
_STIFFNESS_UNIT = 500.0
"""N·m/rad in a gain of 1. Another page of the same authors has 688.58, measured: see `MotorFamily.stiffness_doubt`."""
_DAMPING_UNIT = 0.5
"""N·m·s/rad in a gain of 1; 1.125 there."""
_INT16, _INT32 = 2**15 - 1, 2**31 - 1
_COMMAND = struct.Struct(">hhi")
_GAINS = struct.Struct(">ff")
_FEEDBACK_1 = struct.Struct(">xxhxxh")
_FEEDBACK_2 = struct.Struct(">xxxxi")


@dataclass(frozen=True, slots=True)
class Reset:
    """Disable: the motor goes limp."""

    device_id: int


@dataclass(frozen=True, slots=True)
class SelectMode:
    """A mode and the intervals of feedback 1, 2 and 3, ms, 0 for none. Selecting MIT enables."""

    device_id: int
    mode: Mode
    intervals: tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Gains:
    """K_p and K_d of the MIT law, N·m/rad and N·m·s/rad; they hold until others are sent."""

    device_id: int
    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class Command:
    """The other three fields of the MIT law, in the motor frame: rad, rad/s and N·m."""

    device_id: int
    position: float
    velocity: float
    effort: float


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback 1. Of its eight bytes four are known."""

    device_id: int
    velocity: float
    """rad/s, not beyond ±3.14."""
    effort: float
    """N·m, from the current."""


@dataclass(frozen=True, slots=True)
class PositionFeedback:
    """Feedback 2. Of its eight bytes four are known."""

    device_id: int
    position: float
    """rad, of the output."""


@dataclass(frozen=True, slots=True)
class Malformed:
    """A frame with a Sito identifier that cannot be read."""

    device_id: int
    reason: str
    """Such as `feedback 1 with 5 bytes, expected 8`."""


HostMessage: TypeAlias = Reset | SelectMode | Gains | Command
MotorMessage: TypeAlias = Feedback | PositionFeedback


def rounded(value: float) -> int:
    """To the nearest whole number; a half away from zero."""
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def split_identifier(frame: Frame) -> tuple[int, int] | None:
    """Device id and message type of a frame with a Sito identifier; None for any other frame."""
    if not frame.is_extended or frame.is_remote or frame.is_error or frame.arbitration_id >> 16 != _PREFIX:
        return None
    return frame.arbitration_id >> 8 & 0xFF, frame.arbitration_id & 0xFF


def encode(message: HostMessage | MotorMessage, model: MotorModel) -> Frame:
    """Return the frame of a message, unknown bytes zero; a `FieldError` for what does not fit: it is never wrapped."""
    _check("device_id", message, message.device_id, 1, LARGEST_DEVICE_ID)
    match message:
        case Reset():
            kind, data = MessageType.RESET, _RESET
        case SelectMode():
            for interval in message.intervals:
                _check("intervals", message, interval, 0, LARGEST_INTERVAL)
            kind, data = MessageType.SELECT_MODE, bytes([message.mode, *message.intervals]).ljust(_LENGTH, b"\0")
        case Gains():
            kind, data = MessageType.GAINS, _gains(message)
        case Command():
            counts = _counts("effort", message, model), _counts("velocity", message), _counts("position", message)
            kind, data = MessageType.COMMAND, _COMMAND.pack(*counts)
        case Feedback():
            kind = MessageType.FEEDBACK_1
            data = _FEEDBACK_1.pack(_counts("effort", message, model), _counts("velocity", message))
        case PositionFeedback():
            kind, data = MessageType.FEEDBACK_2, _FEEDBACK_2.pack(_counts("position", message))
    return Frame(_PREFIX << 16 | message.device_id << 8 | kind, data)


def _check(field: str, message: object, value: int, lowest: int, highest: int) -> None:
    if not lowest <= value <= highest:
        raise FieldError(f"{type(message).__name__}.{field}: is {value}, expected {lowest} to {highest}")


def _gains(message: Gains) -> bytes:
    for field in ("stiffness", "damping"):
        value = getattr(message, field)
        if not (math.isfinite(value) and value >= 0.0):
            raise FieldError(f"Gains.{field}: is {value}, expected a finite number >= 0")
    try:
        return _GAINS.pack(message.stiffness / _STIFFNESS_UNIT, message.damping / _DAMPING_UNIT)
    except OverflowError:
        raise FieldError(f"Gains: are {message.stiffness:g} and {message.damping:g}, beyond a float32") from None


def _counts(field: str, message: object, model: MotorModel | None = None) -> int:
    """Return the integer of a field; an effort needs its motor's model."""
    value = getattr(message, field)
    limit = _INT32 if field == "position" else _INT16
    scaled = value * SITO_COUNTS_PER_RAD if model is None else value * (_INT16 / model.effort)
    if not abs(scaled) < limit + 0.5:  # NaN too
        largest = limit / SITO_COUNTS_PER_RAD if model is None else model.effort
        raise FieldError(f"{type(message).__name__}.{field}: is {value}, expected within ±{largest:g}")
    return rounded(scaled)


def decode(  # noqa: PLR0911 - one for each message
    frame: Frame, model: MotorModel
) -> HostMessage | MotorMessage | Malformed | None:
    """Return what a frame from or to a motor of this model says; never raises. None: not one of Sito's types."""
    parts = split_identifier(frame)
    if parts is None or parts[1] not in _DECODED:
        return None
    (device_id, kind), data = parts, frame.data
    if len(data) != _LENGTH:
        name = MessageType(kind).name.lower().replace("_", " ")
        return Malformed(device_id, f"{name} with {len(data)} bytes, expected {_LENGTH}")
    effort_unit = model.effort / _INT16
    match kind:
        case MessageType.RESET if data != _RESET:
            return Malformed(device_id, f"reset with {data.hex(' ')}, expected 55s")
        case MessageType.RESET:
            return Reset(device_id)
        case MessageType.SELECT_MODE if data[0] not in tuple(Mode):
            return Malformed(device_id, f"select mode with mode 0x{data[0]:02X}, expected 0x08 or 0x09")
        case MessageType.SELECT_MODE:
            return SelectMode(device_id, Mode(data[0]), (data[1], data[2], data[3]))
        case MessageType.GAINS:
            stiffness, damping = _GAINS.unpack(data)
            if not (0.0 <= stiffness < math.inf and 0.0 <= damping < math.inf):  # NaN too
                return Malformed(device_id, f"gains of {stiffness:g} and {damping:g}, expected finite numbers >= 0")
            return Gains(device_id, stiffness * _STIFFNESS_UNIT, damping * _DAMPING_UNIT)
        case MessageType.COMMAND:
            current, velocity, position = _COMMAND.unpack(data)
            return Command(
                device_id, position / SITO_COUNTS_PER_RAD, velocity / SITO_COUNTS_PER_RAD, current * effort_unit
            )
        case MessageType.FEEDBACK_1:
            current, velocity = _FEEDBACK_1.unpack(data)
            return Feedback(device_id, velocity / SITO_COUNTS_PER_RAD, current * effort_unit)
        case _:
            return PositionFeedback(device_id, _FEEDBACK_2.unpack(data)[0] / SITO_COUNTS_PER_RAD)


_REPEATS = 2
"""Ticks after a change of gains in which they are sent again."""
_COMMAND_FRAME, _GAINS_FRAME = 0, 1
"""Numbers that tell a motor's two frames apart."""


class SitoEncoder:
    """Commands to frames for motors in a fixed order. It knows what was sent before: one for each activation.

    Gains have a frame of their own, which nothing acknowledges, and hold until others come. So what a command means
    depends on the gains that the motor has, and the order of the two frames matters: softer gains go before the
    command, stiffer ones after it, so that no target is ever held with gains that were not meant for it. The protocol
    wants gains only when they change; here they go three times then, to one motor after the other in every tick
    besides, and in every tick to a motor that is to have no stiffness, because a lost frame would leave a motor stiff
    forever.
    """

    def __init__(self, motors: MotorGroup) -> None:
        """Begin with motors that have zero gains, as after enabling."""
        self._motors = motors
        self._sent = np.zeros((2, motors.count))
        self._repeats = np.full(motors.count, _REPEATS)
        self._turn = 0

    def encode(self, values: FloatArray) -> list[tuple[int, int, Frame]]:
        """Return motor, kind and frame of one command to every motor; values as in `MotorLink.command`."""
        clipped = values
        self._turn = (self._turn + 1) % self._motors.count
        frames: list[tuple[int, int, Frame]] = []
        for i, (position, velocity, effort, stiffness, damping) in enumerate(clipped.T.tolist()):
            device_id, model = self._motors.motor_id[i], self._motors.model[i]
            command = i, _COMMAND_FRAME, encode(Command(device_id, position, velocity, effort), model)
            before, has_changed = self._sent[0, i], (self._sent[:, i] != clipped[3:, i]).any()
            self._repeats[i] = _REPEATS if has_changed else self._repeats[i] - 1
            if stiffness > 0.0 and not has_changed and self._repeats[i] < 0 and i != self._turn:
                frames.append(command)
                continue
            self._sent[:, i] = clipped[3:, i]
            gains = i, _GAINS_FRAME, encode(Gains(device_id, stiffness, damping), model)
            frames += [command, gains] if stiffness > before else [gains, command]
        return frames


def limp_frames(device_id: int, model: MotorModel, position: float = 0.0) -> tuple[Frame, ...]:
    """Zero gains and zero current, in this order. The position, rad, says nothing while the gains are zero."""
    return damping_frames(device_id, model, 0.0, position)


def damping_frames(device_id: int, model: MotorModel, damping: float, position: float = 0.0) -> tuple[Frame, ...]:
    """Return what only brakes a motor, N·m·s/rad: gains twice, for no frame is acknowledged, then the command."""
    gains = encode(Gains(device_id, 0.0, min(max(damping, 0.0), model.damping)), model)
    return gains, gains, encode(Command(device_id, position, 0.0, 0.0), model)


def reset_frames(device_id: int, model: MotorModel) -> tuple[Frame, ...]:
    """Return what disables a motor: limp first, in case it does not obey the reset."""
    return *limp_frames(device_id, model), encode(Reset(device_id), model)
