"""Messages to frames, and back: commands and replies, for the host's side and for the motors'."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.messages import (
    FrameType,
    Identifier,
    Ignored,
    Malformed,
    join_identifier,
    split_identifier,
)
from humanoid_sim.robots.motors import MotorModel

LARGEST_MOTOR_ID = 127
UNSIGNED_STEPS = 65535
SIGNED_STEPS = 32767  # from zero to full scale
_VERSION = b"\x00\xc4"  # first bytes of a stop frame that asks for the version instead
_VERSION_MARK = b"\x00\xc4\x56"  # of a version reply, a frame of type 2; as a status -12.49 rad, and 1050 °C
_VERSION_END = len(_VERSION_MARK) + 4
_COUNT = bytes(range(1, 9))  # data of a save; its first six bytes also precede the setting of type 24
_WORDS = struct.Struct(">HHHH")
_FAULTS = struct.Struct("<II")
_PARAMETER = struct.Struct("<Hxx4s")
_MODES = tuple(messages.MotorMode)
_STATUS_FAULTS = tuple(messages.StatusFault(bits) for bits in range(64))  # quicker than making them for every status


def to_signed(value: float, limit: float) -> int:
    """Return the raw field of a finite position, velocity or effort, cut off at ±limit: 0 to 65534.

    The manuals' own formula has 65535 steps and no raw value for zero; by this one zero is exactly 32767. They differ
    by half a step in the middle: a motor that reads with theirs takes 0 for -2e-4 rad and -3e-4 N·m (rs-02).
    """
    return math.trunc((min(max(value, -limit), limit) / limit + 1.0) * SIGNED_STEPS)


def from_signed(raw: int, limit: float) -> float:
    """Return the value of a raw field, 0 to 65535, the last of which lies beyond the limit by 0.003 %."""
    return (raw / SIGNED_STEPS - 1.0) * limit


def to_unsigned(value: float, limit: float) -> int:
    """Return the raw field of a finite gain, cut off at 0 and at the limit: 0 to 65535."""
    return math.trunc(min(max(value, 0.0), limit) / limit * UNSIGNED_STEPS)


def from_unsigned(raw: int, limit: float) -> float:
    """Return the gain of a raw field, 0 to 65535."""
    return raw * limit / UNSIGNED_STEPS


class _Row(NamedTuple):
    """A host's command: how it is written, the bytes that a motor needs of it, and how it reads them."""

    kind: FrameType
    command: type[messages.HostCommand]
    data: Callable[[Any], bytes] = lambda _: b""
    least: int = 0
    fields: Callable[[bytes], tuple[Any, ...] | None] = lambda _: ()  # None: another command, or a setting that is none


_ROWS = (
    _Row(FrameType.GET_DEVICE_ID, messages.GetDeviceId),
    _Row(FrameType.ENABLE, messages.Enable),
    _Row(
        FrameType.STOP, messages.ReadVersion, lambda _: _VERSION, 0, lambda data: () if data[:2] == _VERSION else None
    ),
    _Row(FrameType.STOP, messages.Stop, lambda stop: bytes([stop.clear_fault]), 0, lambda data: (data[:1] == b"\1",)),
    _Row(FrameType.SET_ZERO, messages.SetZero, lambda _: b"\1", 1, lambda data: () if data[0] == 1 else None),
    _Row(FrameType.SET_DEVICE_ID, messages.SetDeviceId),  # its field is in the identifier
    _Row(
        FrameType.READ_PARAMETER,
        messages.ReadParameter,
        lambda read: _PARAMETER.pack(read.index, b""),
        8,
        lambda data: _PARAMETER.unpack(data)[:1],
    ),
    _Row(
        FrameType.WRITE_PARAMETER,
        messages.WriteParameter,
        lambda write: _PARAMETER.pack(write.index, write.payload),
        8,
        _PARAMETER.unpack,
    ),
    _Row(FrameType.SAVE_PARAMETERS, messages.SaveParameters, lambda _: _COUNT),
    _Row(
        FrameType.ACTIVE_REPORT,
        messages.SetActiveReport,
        lambda report: _COUNT[:6] + bytes([report.is_on]),
        7,
        lambda data: (data[6] == 1,) if data[6] <= 1 else None,
    ),
)
_BY_COMMAND = {row.command: row for row in _ROWS}


# --- commands


def encode_command(command: messages.Command, model: MotorModel) -> Frame:
    """Return the frame of a command. Values of `OperationControl` are cut off at the model's ranges.

    Raises `FieldError` if an id is not one, or a value is not finite: other drivers turn NaN into full negative scale.
    """
    _check_id(type(command).__name__, command.motor_id)
    if isinstance(command, messages.OperationControl):
        return _encode_operation(command, model)
    high = 0
    if isinstance(command, messages.SetDeviceId):
        _check_id("SetDeviceId.new_id", high := command.new_id)
    row = _BY_COMMAND[type(command)]
    identifier = join_identifier(row.kind, high, command.host_id, command.motor_id)
    return Frame(identifier, row.data(command).ljust(8, b"\0"))


def _check_id(what: str, motor_id: int) -> None:
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise FieldError(f"{what}: motor id is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")


def _encode_operation(command: messages.OperationControl, model: MotorModel) -> Frame:
    values = command.position, command.velocity, command.effort, command.stiffness, command.damping
    if not all(map(math.isfinite, values)):
        raise FieldError(f"OperationControl: is {values} for motor {command.motor_id}, expected finite numbers")
    data = _WORDS.pack(
        to_signed(command.position, model.position),
        to_signed(command.velocity, model.velocity),
        to_unsigned(command.stiffness, model.stiffness),
        to_unsigned(command.damping, model.damping),
    )
    effort = to_signed(command.effort, model.effort)
    return Frame(FrameType.OPERATION_CONTROL << 24 | effort << 8 | command.motor_id, data)


def decode_command(frame: Frame, motor_id: int, model: MotorModel) -> messages.Command | Ignored | Malformed:
    """Return the command that a frame gives to a motor with this id; never raises.

    Frames that other hosts send are accepted as well: no data in type 0, 3 and 4, one byte in type 6, anything in type
    22, and any last byte in type 24.
    """
    if reason := _another_protocol(frame):
        return Ignored(reason)
    (kind, high, host, destination), data = split_identifier(frame.arbitration_id), frame.data
    rows = [row for row in _ROWS if row.kind == kind]
    is_operation = kind == FrameType.OPERATION_CONTROL
    if destination != motor_id or not (rows or is_operation):
        return Ignored("unknown_device" if destination != motor_id else "unknown_type")
    least = 8 if is_operation else rows[0].least
    if not least <= len(data) <= 8:
        return Malformed(motor_id, f"type {kind} with {len(data)} bytes, expected {least} to {8}")
    if is_operation:
        position, velocity, stiffness, damping = _WORDS.unpack(data)
        return messages.OperationControl(
            motor_id,
            from_signed(position, model.position),
            from_signed(velocity, model.velocity),
            from_signed(frame.arbitration_id >> 8 & 0xFFFF, model.effort),
            from_unsigned(stiffness, model.stiffness),
            from_unsigned(damping, model.damping),
        )
    for row in rows:
        fields = (high,) if row.command is messages.SetDeviceId else row.fields(data)
        if fields is not None:
            return row.command(motor_id, *fields, host_id=host)
    return Malformed(motor_id, f"type {kind} with a setting that is none: {data.hex(' ')}")


def _another_protocol(frame: Frame) -> str:
    """Return why a frame is none of this protocol's; empty: it may be."""
    if frame.is_error or frame.is_remote:
        return "error_frame" if frame.is_error else "remote_frame"
    return "" if frame.is_extended else "standard_id"


# --- replies

_BOTH = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER, FrameType.ACTIVE_REPORT})
"""Types of a command and of its reply; the destination says which."""
_DEFINED = frozenset(int(kind) for kind in FrameType)
_NAMES: Mapping[int, str] = {
    FrameType.STATUS: "status",
    FrameType.ACTIVE_REPORT: "status",
    FrameType.FAULT_REPORT: "fault report",
    FrameType.READ_PARAMETER: "parameter reply",
    FrameType.GET_DEVICE_ID: "device-id reply",
}


def decode_reply(  # noqa: PLR0911 - one for each reply
    frame: Frame, models: Mapping[int, MotorModel], host_id: int
) -> messages.Reply | Ignored | Malformed:
    """Return the reply that a frame gives to a host; never raises.

    Only its request distinguishes a version for certain from a status that begins with the same three bytes: a motor at
    -12.49 rad that moves at a third of its velocity range. Such a frame is read as a version, requested or not: a
    status missed in that one spot ages a joint by a period, while a version read as a position is a jump.

    Args:
        models: the configured motors by id; frames of others are ignored, but for `DeviceId`, which scans want of all.
        host_id: the receiver's own; answers to other hosts are ignored.
    """
    if reason := _another_protocol(frame) or _addressee(split_identifier(frame.arbitration_id), models, host_id):
        return Ignored(reason)
    (kind, high, motor_id, destination), data = split_identifier(frame.arbitration_id), frame.data
    is_status = kind in (FrameType.STATUS, FrameType.ACTIVE_REPORT)
    if is_status and data.startswith(_VERSION_MARK) and len(data) >= _VERSION_END:
        first, second, third, fourth = data[len(_VERSION_MARK) : _VERSION_END]
        return messages.Version(motor_id, destination, (first, second, third, fourth))
    if len(data) != 8:
        return Malformed(motor_id, f"{_NAMES[kind]} with {len(data)} bytes, expected {8}")
    if kind == FrameType.GET_DEVICE_ID:
        return messages.DeviceId(motor_id, data)
    if is_status:
        position, velocity, effort, temperature = _WORDS.unpack(data)
        model = models[motor_id]
        return messages.Status(
            motor_id,
            destination,
            from_signed(position, model.position),
            from_signed(velocity, model.velocity),
            from_signed(effort, model.effort),
            temperature / 10.0,
            _MODES[high >> 6],
            _STATUS_FAULTS[high & 0x3F],
            kind == FrameType.ACTIVE_REPORT,
        )
    if kind == FrameType.FAULT_REPORT:
        faults, warnings = _FAULTS.unpack(data)
        return messages.FaultReport(motor_id, destination, messages.FaultBit(faults), messages.WarningBit(warnings))
    index, payload = _PARAMETER.unpack(data)
    return messages.ParameterReply(motor_id, destination, index, payload, high == 0)


def _addressee(parts: Identifier, models: Mapping[int, MotorModel], host_id: int) -> str:
    """Classify the addressee of a frame; empty for a reply to this host."""
    kind, _, motor_id, destination = parts
    if kind == FrameType.GET_DEVICE_ID and destination in {messages.BROADCAST_ID, host_id}:
        return ""
    if kind in (FrameType.STATUS, FrameType.FAULT_REPORT) or (kind in _BOTH and destination == host_id):
        known = "" if motor_id in models else "unknown_device"
        return known if destination == host_id else "other_host"
    if kind not in _DEFINED:
        return "unknown_type"
    return "other_host" if kind in _BOTH and motor_id in models and destination not in models else "host_command"


def encode_reply(reply: messages.Reply, model: MotorModel) -> Frame:
    """Return the frame of a motor's reply. Values of a status are cut off at the model's ranges, not wrapped."""
    high = 0
    match reply:
        case messages.DeviceId():
            return Frame(join_identifier(FrameType.GET_DEVICE_ID, 0, reply.motor_id, messages.BROADCAST_ID), reply.uid)
        case messages.Status():
            kind = FrameType.ACTIVE_REPORT if reply.is_report else FrameType.STATUS
            high = reply.mode << 6 | reply.faults
            data = _WORDS.pack(
                to_signed(reply.position, model.position),
                to_signed(reply.velocity, model.velocity),
                to_signed(reply.effort, model.effort),
                min(max(round(reply.temperature * 10.0), 0), 0xFFFF),
            )
        case messages.FaultReport():
            kind, data = FrameType.FAULT_REPORT, _FAULTS.pack(int(reply.faults), int(reply.warnings))
        case messages.ParameterReply():
            kind, high = FrameType.READ_PARAMETER, 0 if reply.is_success else 1
            data = _PARAMETER.pack(reply.index, reply.payload)
        case messages.Version():
            # An enabled motor's mode bits are not documented here; those of a stopped one are zero.
            kind, data = FrameType.STATUS, (_VERSION_MARK + bytes(reply.version)).ljust(8, b"\0")
    return Frame(join_identifier(kind, high, reply.motor_id, reply.host_id), data)
