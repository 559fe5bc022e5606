"""The Robstride family's private CAN protocol: frames of commands and replies, for the host's side and for the motors'.

Sources: the manuals of 2026-04-28 (RS00 to RS06), the vendor's samples and Actuator-Control (commit d74dd3f). Values
are in the motor frame, in rad, s and N·m. `host_id` is the host's own id; motor ids are 1 to 127, the factory's.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeAlias

import msgspec

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.robots.motors import MotorModel

DEFAULT_HOST_ID = 0xFD  # in every example of the vendor
BROADCAST_ID = 0xFE  # destination of a device-id reply
LARGEST_MOTOR_ID = 127


class FrameType(IntEnum):
    """Communication type, bits 28..24 of the identifier. A status answers where nothing else is said."""

    GET_DEVICE_ID = 0  # answered by `DeviceId`
    OPERATION_CONTROL = 1  # see `OperationControl`
    STATUS = 2
    ENABLE = 3
    STOP = 4  # the motor goes limp; with `CLEAR_FAULTS` as well, with `READ_VERSION` only answered by `Version`
    SET_ZERO = 6  # with `HERE`; ignored in position mode PP
    SET_DEVICE_ID = 7  # at once; `high` is the new id, from which `DeviceId` answers
    READ_PARAMETER = 17  # with `parameter_data`; answered by `ParameterReply`
    WRITE_PARAMETER = 18  # likewise; lost at power-off unless saved
    FAULT_REPORT = 21
    SAVE_PARAMETERS = 22  # with `SAVE`
    SET_BAUD_RATE = 23
    ACTIVE_REPORT = 24  # with `REPORTS_ON` or `REPORTS_OFF`: statuses without a request; newer firmware only
    SET_PROTOCOL = 25


CLEAR_FAULTS = b"\1"
READ_VERSION = b"\0\xc4"
HERE = b"\1"
SAVE = bytes(range(1, 9))
REPORTS_ON, REPORTS_OFF = SAVE[:6] + b"\1", SAVE[:6] + b"\0"


class MotorMode(IntEnum):
    """Bits 23..22 of a status frame's identifier."""

    RESET = 0  # not enabled: after power-on, a stop, a CAN timeout, a brown-out
    CALIBRATION = 1
    RUN = 2  # enabled: executes commands
    UNDEFINED = 3


class StatusFault(IntFlag):
    """Bits 21..16 of a status frame's identifier. Overvoltage has none: only a fault report shows it."""

    UNDERVOLTAGE = 1 << 0
    PHASE_OVERCURRENT = 1 << 1
    MOTOR_OVERTEMPERATURE = 1 << 2
    ENCODER_FAULT = 1 << 3
    STALL_OVERLOAD = 1 << 4
    UNCALIBRATED = 1 << 5


class FaultBit(IntFlag):
    """The fault word of a fault report (type 21), and of the function-code parameter that holds it."""

    MOTOR_OVERTEMPERATURE = 1 << 0
    DRIVER_CHIP = 1 << 1
    UNDERVOLTAGE = 1 << 2  # below 12 V
    OVERVOLTAGE = 1 << 3  # above 60 V
    PHASE_B_OVERCURRENT = 1 << 4
    PHASE_C_OVERCURRENT = 1 << 5
    ENCODER_UNCALIBRATED = 1 << 7
    HARDWARE_IDENTIFICATION = 1 << 8
    POSITION_INITIALISATION = 1 << 9
    STALL_OVERLOAD = 1 << 14
    PHASE_A_OVERCURRENT = 1 << 16


class WarningBit(IntFlag):
    """The warning word of a fault report."""

    MOTOR_OVERTEMPERATURE_WARNING = 1 << 0


def flag_names(flags: IntFlag) -> tuple[str, ...]:
    """Return names of the set bits in rising order, such as `stall_overload`; a bit without a name is `bit13`."""
    if not flags:  # as in almost every tick, and naming is slow
        return ()
    names = {int(member): str(member.name).lower() for member in type(flags)}
    bits = [shift for shift in range(int(flags).bit_length()) if int(flags) >> shift & 1]
    return tuple(names.get(1 << shift, f"bit{shift}") for shift in bits)


# --- commands


def split_identifier(arbitration_id: int) -> tuple[int, int, int, int]:
    """Return the parts of a 29-bit identifier: type, high and low byte, destination.

    The type is a `FrameType`, or a number without meaning; the high byte has mode and faults of a status, a reply's
    result, the high byte of an effort, or a new id; the low byte the sender's id, or the low byte of an effort.
    """
    kind, high, low, destination = arbitration_id.to_bytes(4, "big")
    return kind, high, low, destination


def encode_command(
    kind: FrameType, motor_id: int, data: bytes = b"", *, high: int = 0, host_id: int = DEFAULT_HOST_ID
) -> Frame:
    """Return the frame of any command but operation control."""
    return Frame(kind << 24 | high << 16 | host_id << 8 | motor_id, data.ljust(8, b"\0"))


_PARAMETER = struct.Struct("<Hxx4s")


def parameter_data(index: int, payload: bytes = b"") -> bytes:
    """Return the data that reads a parameter, or writes it: 4 bytes of `parameters.pack_value`."""
    return _PARAMETER.pack(index, payload)


class OperationControl(NamedTuple):
    """What operation control demands: `torque = damping·(velocity - v) + stiffness·(position - p) + effort`."""

    position: float
    velocity: float
    effort: float
    stiffness: float
    damping: float


SIGNED_STEPS = 32767  # from zero to full scale
UNSIGNED_STEPS = 65535
_WORDS = struct.Struct(">HHHH")


def _to_signed(value: float, limit: float) -> int:
    """Return the raw field of a finite position, velocity or effort, cut off at ±limit: 0 to 65534.

    The manuals' own formula has 65535 steps and no raw value for zero; by this one zero is exactly 32767.
    """
    return math.trunc((min(max(value, -limit), limit) / limit + 1.0) * SIGNED_STEPS)


def _from_signed(raw: int, limit: float) -> float:
    return (raw / SIGNED_STEPS - 1.0) * limit


def _to_unsigned(value: float, limit: float) -> int:
    return math.trunc(min(max(value, 0.0), limit) / limit * UNSIGNED_STEPS)


def encode_operation(motor_id: int, command: OperationControl, model: MotorModel) -> Frame:
    """Return the frame of operation control, whose values are cut off at the model's ranges.

    Raises `FieldError` if a value is not finite: other drivers turn NaN into full negative scale.
    """
    if not all(map(math.isfinite, command)):
        raise FieldError(f"OperationControl: is {tuple(command)} for motor {motor_id}, expected finite numbers")
    data = _WORDS.pack(
        _to_signed(command.position, model.position),
        _to_signed(command.velocity, model.velocity),
        _to_unsigned(command.stiffness, model.stiffness),
        _to_unsigned(command.damping, model.damping),
    )
    effort = _to_signed(command.effort, model.effort)  # in the identifier, which has no room for a host id
    return Frame(FrameType.OPERATION_CONTROL << 24 | effort << 8 | motor_id, data)


def decode_operation(frame: Frame, model: MotorModel) -> OperationControl:
    """Return what a frame of operation control, of 8 bytes, demands of a motor."""
    position, velocity, stiffness, damping = _WORDS.unpack(frame.data)
    return OperationControl(
        _from_signed(position, model.position),
        _from_signed(velocity, model.velocity),
        _from_signed(frame.arbitration_id >> 8 & 0xFFFF, model.effort),
        stiffness * model.stiffness / UNSIGNED_STEPS,
        damping * model.damping / UNSIGNED_STEPS,
    )


# --- replies


class Message(msgspec.Struct, frozen=True):
    """A message from a motor."""

    motor_id: int


class Status(Message, frozen=True):
    """Type 2, or type 24 where `is_report`."""

    position: float  # runs cyclically within ±4π
    velocity: float
    effort: float
    temperature: float  # °C, not below 0
    mode: MotorMode
    faults: StatusFault
    is_report: bool = False


class FaultReport(Message, frozen=True):
    """Type 21. Both words zero: no fault."""

    faults: FaultBit
    warnings: WarningBit


class ParameterReply(Message, frozen=True):
    """Type 17."""

    index: int
    payload: bytes  # 4 bytes, little-endian, left-aligned; without meaning unless `is_success`
    is_success: bool = True


class DeviceId(Message, frozen=True):
    """Type 0, to everybody."""

    uid: bytes  # 8 bytes, the motor's microcontroller


class Version(Message, frozen=True):
    """Type 2 with a mark: the firmware's version."""

    version: tuple[int, int, int, int]  # `(0, 2, 3, 6)` is firmware 0.2.3.6


class Malformed(Message, frozen=True):
    """A frame of a configured motor that cannot be read."""

    reason: str


class Ignored(msgspec.Struct, frozen=True):
    """A frame that says nothing to this host, and why: `standard_id`, `unknown_device`, `host_command` and so on."""

    reason: str


Reply: TypeAlias = Status | FaultReport | ParameterReply | DeviceId | Version

_FAULTS = struct.Struct("<II")
_VERSION_MARK = b"\x00\xc4\x56"  # of a version reply, a frame of type 2; as a status -12.49 rad, and 1050 °C
_VERSION_END = len(_VERSION_MARK) + 4
_MODES = tuple(MotorMode)
_STATUS_FAULTS = tuple(StatusFault(bits) for bits in range(64))  # quicker than making them for every status
_TYPES = frozenset(int(kind) for kind in FrameType)
_BOTH = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER, FrameType.ACTIVE_REPORT})
"""Types of a command and of its reply; the destination says which."""


def decode_reply(  # noqa: PLR0911 - one for each reply
    frame: Frame, models: Mapping[int, MotorModel], host_id: int
) -> Reply | Ignored | Malformed:
    """Return the reply that a frame gives to a host; never raises.

    Only its request distinguishes a version for certain from a status that begins with the same three bytes: a motor at
    -12.49 rad that moves at a third of its velocity range. Such a frame is read as a version, requested or not: a
    status missed in that one spot ages a joint by a period, while a version read as a position is a jump.

    Args:
        models: the configured motors by id; frames of others are ignored, but for `DeviceId`, which scans want of all.
        host_id: the receiver's own; answers to other hosts are ignored.
    """
    (kind, high, motor_id, destination), data = split_identifier(frame.arbitration_id), frame.data
    if frame.is_error or frame.is_remote or not frame.is_extended:
        return Ignored("error_frame" if frame.is_error else "remote_frame" if frame.is_remote else "standard_id")
    if reason := _addressee(kind, motor_id, destination, models, host_id):
        return Ignored(reason)
    is_status = kind in (FrameType.STATUS, FrameType.ACTIVE_REPORT)
    if is_status and data.startswith(_VERSION_MARK) and len(data) >= _VERSION_END:
        first, second, third, fourth = data[len(_VERSION_MARK) : _VERSION_END]
        return Version(motor_id, (first, second, third, fourth))
    if len(data) != 8:
        return Malformed(motor_id, f"{type_name(kind)} with {len(data)} bytes, expected 8")
    if kind == FrameType.GET_DEVICE_ID:
        return DeviceId(motor_id, data)
    if kind == FrameType.READ_PARAMETER:
        index, payload = _PARAMETER.unpack(data)
        return ParameterReply(motor_id, index, payload, high == 0)
    if kind == FrameType.FAULT_REPORT:
        faults, warnings = _FAULTS.unpack(data)
        return FaultReport(motor_id, FaultBit(faults), WarningBit(warnings))
    position, velocity, effort, temperature = _WORDS.unpack(data)
    model = models[motor_id]
    return Status(
        motor_id,
        _from_signed(position, model.position),
        _from_signed(velocity, model.velocity),
        _from_signed(effort, model.effort),
        temperature / 10.0,
        _MODES[high >> 6],
        _STATUS_FAULTS[high & 0x3F],
        kind == FrameType.ACTIVE_REPORT,
    )


def type_name(kind: int) -> str:
    """Return `operation control` for the type of an identifier."""
    return FrameType(kind).name.lower().replace("_", " ")


def _addressee(kind: int, motor_id: int, destination: int, models: Mapping[int, MotorModel], host_id: int) -> str:
    """Return why a frame is not a reply to this host; empty if it is one."""
    if kind == FrameType.GET_DEVICE_ID and destination in {BROADCAST_ID, host_id}:
        return ""
    if kind in (FrameType.STATUS, FrameType.FAULT_REPORT) or (kind in _BOTH and destination == host_id):
        known = "" if motor_id in models else "unknown_device"
        return known if destination == host_id else "other_host"
    if kind not in _TYPES:
        return "unknown_type"
    return "other_host" if kind in _BOTH and motor_id in models and destination not in models else "host_command"


def encode_reply(reply: Reply, model: MotorModel, host_id: int = DEFAULT_HOST_ID) -> Frame:
    """Return the frame of a motor's reply. Values of a status are cut off at the model's ranges, not wrapped."""
    high = 0
    match reply:
        case DeviceId():
            kind, host_id, data = FrameType.GET_DEVICE_ID, BROADCAST_ID, reply.uid
        case Status():
            kind = FrameType.ACTIVE_REPORT if reply.is_report else FrameType.STATUS
            high = reply.mode << 6 | reply.faults
            data = _WORDS.pack(
                _to_signed(reply.position, model.position),
                _to_signed(reply.velocity, model.velocity),
                _to_signed(reply.effort, model.effort),
                min(max(round(reply.temperature * 10.0), 0), 0xFFFF),
            )
        case FaultReport():
            kind, data = FrameType.FAULT_REPORT, _FAULTS.pack(int(reply.faults), int(reply.warnings))
        case ParameterReply():
            kind, high = FrameType.READ_PARAMETER, 0 if reply.is_success else 1
            data = _PARAMETER.pack(reply.index, reply.payload)
        case Version():
            kind, data = FrameType.STATUS, (_VERSION_MARK + bytes(reply.version)).ljust(8, b"\0")
    return Frame(kind << 24 | high << 16 | reply.motor_id << 8 | host_id, data)
