"""Messages to frames, and back: commands and replies, for the host's side and for the motors'."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.messages import (
    BROADCAST_ID,
    DATA_LENGTH,
    FaultBit,
    FrameType,
    Identifier,
    Ignored,
    Malformed,
    MotorMode,
    StatusFault,
    WarningBit,
    from_signed,
    from_unsigned,
    join_identifier,
    split_identifier,
    to_signed,
    to_unsigned,
)
from humanoid_sim.robots.motors import MotorModel

LARGEST_MOTOR_ID = 127
VERSION_REQUEST = b"\x00\xc4"
"""First bytes of a stop frame that asks for the version instead."""
VERSION_MARK = b"\x00\xc4\x56"
"""First bytes of a version reply, a frame of type 2. As a status they would mean -12.49 rad, and 1050 °C."""
_VERSION_END = len(VERSION_MARK) + 4
_COUNT = bytes(range(1, 9))
"""Data of a save; the first six bytes also precede the setting of type 24, whose last byte is free."""
_TYPES: Mapping[type[messages.HostCommand], tuple[FrameType, int]] = {
    messages.GetDeviceId: (FrameType.GET_DEVICE_ID, 0),
    messages.Enable: (FrameType.ENABLE, 0),
    messages.Stop: (FrameType.STOP, 0),
    messages.ReadVersion: (FrameType.STOP, 0),
    messages.SetZero: (FrameType.SET_ZERO, 1),
    messages.SetDeviceId: (FrameType.SET_DEVICE_ID, 0),
    messages.ReadParameter: (FrameType.READ_PARAMETER, DATA_LENGTH),
    messages.WriteParameter: (FrameType.WRITE_PARAMETER, DATA_LENGTH),
    messages.SaveParameters: (FrameType.SAVE_PARAMETERS, 0),
    messages.SetActiveReport: (FrameType.ACTIVE_REPORT, 7),
}
"""By command: its frame's type, and the bytes that a motor needs of it."""
_LEAST_BYTES: dict[int, int] = dict(_TYPES.values())
_WORDS = struct.Struct(">HHHH")
_INDEX = struct.Struct("<H")
_FAULTS = struct.Struct("<II")
_PARAMETER = struct.Struct("<Hxx4s")
_TEMPERATURE_STEPS = 10  # in 1 °C
_MODES = tuple(MotorMode)
_STATUS_FAULTS = tuple(StatusFault(bits) for bits in range(64))
"""By number: looking them up is much quicker than making them, and every received status does."""


# --- commands


def encode_command(command: messages.Command, model: MotorModel) -> Frame:
    """Return the frame of a command. Values of `OperationControl` are cut off at the model's ranges.

    Raises `FieldError` if an id is not one, or a value is not finite: other drivers turn NaN into full negative scale.
    """
    _check_id(type(command).__name__, command.motor_id)
    if isinstance(command, messages.OperationControl):
        return _encode_operation(command, model)
    if not 0 <= command.host_id <= 0xFF:
        raise FieldError(f"{type(command).__name__}.host_id: is {command.host_id}, expected 0 to 255")
    high = 0
    match command:
        case messages.Stop(clear_fault=clear):
            data = bytes([clear])
        case messages.ReadVersion():
            data = VERSION_REQUEST
        case messages.SetZero():
            data = b"\x01"
        case messages.SetDeviceId(new_id=high):
            _check_id("SetDeviceId.new_id", high)
            data = b""
        case messages.ReadParameter(index=index):
            data = _parameter_data(index, bytes(4))
        case messages.WriteParameter(index=index, payload=payload):
            data = _parameter_data(index, payload)
        case messages.SaveParameters():
            data = _COUNT
        case messages.SetActiveReport(is_on=is_on):
            data = _COUNT[:6] + bytes([is_on])
        case _:
            data = b""
    kind, _ = _TYPES[type(command)]
    return Frame(join_identifier(kind, high, command.host_id, command.motor_id), data.ljust(DATA_LENGTH, b"\0"))


def _check_id(what: str, motor_id: int) -> None:
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise FieldError(f"{what}: motor id is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")


def _parameter_data(index: int, payload: bytes) -> bytes:
    if not 0 <= index <= 0xFFFF or len(payload) != 4:
        raise FieldError(f"parameter: index {index}, {len(payload)} bytes, expected 0 to 65535 and 4 bytes")
    return _PARAMETER.pack(index, payload)


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
    """Return what a frame says to a motor with this id; never raises.

    Frames that other hosts send are accepted as well: no data in type 0, 3 and 4, one byte in type 6, anything in type
    22, and any last byte in type 24.
    """
    if reason := _another_protocol(frame):
        return Ignored(reason)
    parts = split_identifier(frame.arbitration_id)
    if parts.destination != motor_id:
        return Ignored("unknown_device", parts.destination)
    least = DATA_LENGTH if parts.type == FrameType.OPERATION_CONTROL else _LEAST_BYTES.get(parts.type)
    if least is None:
        return Ignored("unknown_type", motor_id)
    if not least <= len(frame.data) <= DATA_LENGTH:
        return Malformed(motor_id, f"type {parts.type} with {len(frame.data)} bytes, expected {least} to {DATA_LENGTH}")
    return _decode_command(frame, parts, motor_id, model)


def _another_protocol(frame: Frame) -> str:
    """Return why a frame is none of this protocol's; empty: it may be."""
    if frame.is_error:
        return "error_frame"
    if frame.is_remote:
        return "remote_frame"
    return "" if frame.is_extended else "standard_id"


def _decode_command(  # noqa: PLR0911 - one case for each command
    frame: Frame, parts: Identifier, motor_id: int, model: MotorModel
) -> messages.Command | Malformed:
    data, host = frame.data, parts.low
    match parts.type:
        case FrameType.OPERATION_CONTROL:
            position, velocity, stiffness, damping = _WORDS.unpack(data)
            return messages.OperationControl(
                motor_id,
                from_signed(position, model.position),
                from_signed(velocity, model.velocity),
                from_signed(frame.arbitration_id >> 8 & 0xFFFF, model.effort),
                from_unsigned(stiffness, model.stiffness),
                from_unsigned(damping, model.damping),
            )
        case FrameType.GET_DEVICE_ID:
            return messages.GetDeviceId(motor_id, host_id=host)
        case FrameType.ENABLE:
            return messages.Enable(motor_id, host_id=host)
        case FrameType.STOP if data[:2] == VERSION_REQUEST:
            return messages.ReadVersion(motor_id, host_id=host)
        case FrameType.STOP:
            return messages.Stop(motor_id, data[:1] == b"\x01", host_id=host)
        case FrameType.SET_ZERO if data[0] == 1:
            return messages.SetZero(motor_id, host_id=host)
        case FrameType.SET_DEVICE_ID:
            return messages.SetDeviceId(motor_id, parts.high, host_id=host)
        case FrameType.READ_PARAMETER:
            return messages.ReadParameter(motor_id, _INDEX.unpack_from(data)[0], host_id=host)
        case FrameType.WRITE_PARAMETER:
            return messages.WriteParameter(motor_id, _INDEX.unpack_from(data)[0], data[4:8], host_id=host)
        case FrameType.SAVE_PARAMETERS:
            return messages.SaveParameters(motor_id, host_id=host)
        case FrameType.ACTIVE_REPORT if data[6] <= 1:
            return messages.SetActiveReport(motor_id, data[6] == 1, host_id=host)
        case _:
            return Malformed(motor_id, f"type {parts.type} with a setting that is none: {data.hex(' ')}")


# --- replies

_REPLIES = frozenset({FrameType.STATUS, FrameType.FAULT_REPORT})
"""Types that only motors send."""
_BOTH = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER, FrameType.ACTIVE_REPORT})
"""Types of a command and of its reply; the destination says which."""
_DEFINED = frozenset(int(kind) for kind in FrameType)
_NAMES = {
    FrameType.STATUS: "status",
    FrameType.ACTIVE_REPORT: "status",
    FrameType.FAULT_REPORT: "fault report",
    FrameType.READ_PARAMETER: "parameter reply",
    FrameType.GET_DEVICE_ID: "device-id reply",
}


def decode_reply(frame: Frame, models: Mapping[int, MotorModel], host_id: int) -> messages.Reply | Ignored | Malformed:
    """Return what a received frame says to a host; never raises.

    Only its request distinguishes a version for certain from a status that begins with the same three bytes: a motor at
    -12.49 rad that moves at a third of its velocity range. Such a frame is read as a version, requested or not: a
    status missed in that one spot ages a joint by a period, while a version read as a position is a jump.

    Args:
        models: the configured motors by id; frames of others are ignored, but for `DeviceId`, which scans want of all.
        host_id: the receiver's own; answers to other hosts are ignored.
    """
    if reason := _another_protocol(frame):
        return Ignored(reason)
    parts = split_identifier(frame.arbitration_id)
    is_device_id = parts.type == FrameType.GET_DEVICE_ID and parts.destination in {BROADCAST_ID, host_id}
    if is_device_id:
        return messages.DeviceId(parts.low, frame.data) if len(frame.data) == DATA_LENGTH else _bad_length(frame, parts)
    if parts.type in _REPLIES or (parts.type in _BOTH and parts.destination == host_id):
        return _decode_reply(frame, parts, models, host_id)
    if parts.type not in _DEFINED:
        return Ignored("unknown_type", parts.low)
    if parts.type in _BOTH and parts.low in models and parts.destination not in models:
        return Ignored("other_host", parts.low)
    return Ignored("host_command", parts.destination)


def _bad_length(frame: Frame, parts: Identifier) -> Malformed:
    name = _NAMES[FrameType(parts.type)]
    return Malformed(parts.low, f"{name} with {len(frame.data)} bytes, expected {DATA_LENGTH}")


def _decode_reply(  # noqa: PLR0911 - one for each kind of reply
    frame: Frame, parts: Identifier, models: Mapping[int, MotorModel], host_id: int
) -> messages.Reply | Ignored | Malformed:
    kind, high, motor_id, destination = parts
    data, model = frame.data, models.get(motor_id)
    if destination != host_id:
        return Ignored("other_host", motor_id)
    if model is None:
        return Ignored("unknown_device", motor_id)
    is_status = kind in (FrameType.STATUS, FrameType.ACTIVE_REPORT)
    if is_status and data.startswith(VERSION_MARK) and len(data) >= _VERSION_END:
        first, second, third, fourth = data[len(VERSION_MARK) : _VERSION_END]
        return messages.Version(motor_id, destination, (first, second, third, fourth))
    if len(data) != DATA_LENGTH:
        return _bad_length(frame, parts)
    if is_status:
        position, velocity, effort, temperature = _WORDS.unpack(data)
        return messages.Status(
            motor_id,
            destination,
            from_signed(position, model.position),
            from_signed(velocity, model.velocity),
            from_signed(effort, model.effort),
            temperature / _TEMPERATURE_STEPS,
            _MODES[high >> 6],
            _STATUS_FAULTS[high & 0x3F],
            kind == FrameType.ACTIVE_REPORT,
        )
    if kind == FrameType.FAULT_REPORT:
        faults, warnings = _FAULTS.unpack(data)
        return messages.FaultReport(motor_id, destination, FaultBit(faults), WarningBit(warnings))
    index, payload = _PARAMETER.unpack(data)
    return messages.ParameterReply(motor_id, destination, index, payload, high == 0)


def encode_reply(reply: messages.Reply, model: MotorModel) -> Frame:
    """Return the frame of a motor's reply. Values of a status are cut off at the model's ranges, not wrapped."""
    high = 0
    match reply:
        case messages.DeviceId():
            return Frame(join_identifier(FrameType.GET_DEVICE_ID, 0, reply.motor_id, BROADCAST_ID), reply.uid)
        case messages.Status():
            kind = FrameType.ACTIVE_REPORT if reply.is_report else FrameType.STATUS
            high = reply.mode << 6 | reply.faults
            data = _WORDS.pack(
                to_signed(reply.position, model.position),
                to_signed(reply.velocity, model.velocity),
                to_signed(reply.effort, model.effort),
                min(max(round(reply.temperature * _TEMPERATURE_STEPS), 0), 0xFFFF),
            )
        case messages.FaultReport():
            kind, data = FrameType.FAULT_REPORT, _FAULTS.pack(int(reply.faults), int(reply.warnings))
        case messages.ParameterReply():
            kind, high = FrameType.READ_PARAMETER, 0 if reply.is_success else 1
            data = _PARAMETER.pack(reply.index, reply.payload)
        case messages.Version():
            # An enabled motor's mode bits are not documented here; those of a stopped one are zero.
            kind, data = FrameType.STATUS, (VERSION_MARK + bytes(reply.version)).ljust(DATA_LENGTH, b"\0")
    return Frame(join_identifier(kind, high, reply.motor_id, reply.host_id), data)
