"""Messages to frames, and back: commands and replies, for the host's side and for the motors'."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

import numpy as np

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motors import EncodedFrames
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.messages import (
    BROADCAST_ID,
    DATA_LENGTH,
    SIGNED_STEPS,
    UNSIGNED_STEPS,
    FaultBit,
    FrameType,
    Identifier,
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
from humanoid_sim.hardware.robstride.parameters import PAYLOAD_LENGTH
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray
from humanoid_sim.robots.motors import MotorModel

LARGEST_MOTOR_ID = 127
VERSION_REQUEST = b"\x00\xc4"
"""First bytes of a stop frame that asks for the version instead."""
_COUNT = bytes(range(1, 9))
"""Data of a save; the first six bytes also precede the setting in types 23 to 25, whose last byte is free."""
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
    messages.SetBaudRate: (FrameType.SET_BAUD_RATE, 7),
    messages.SetActiveReport: (FrameType.ACTIVE_REPORT, 7),
    messages.SetProtocol: (FrameType.SET_PROTOCOL, 7),
}
"""By command: its frame's type, and the bytes that a motor needs of it."""
_WORDS = struct.Struct(">HHHH")
_INDEX = struct.Struct("<H")


def encode_command(command: messages.Command, model: MotorModel) -> Frame:
    """Return the frame of a command. Values of `OperationControl` are cut off at the model's ranges.

    Raises `FieldError` if an id is not one, or a value is not finite: the reference turns NaN into full negative scale.
    """
    _check_id(f"{type(command).__name__}.motor_id", command.motor_id)
    if isinstance(command, messages.OperationControl):
        return _encode_operation_control(command, model)
    if not 0 <= command.host_id <= 0xFF:
        raise FieldError(f"{type(command).__name__}.host_id: is {command.host_id}, expected 0 to 255")
    kind, _ = _TYPES[type(command)]
    high = command.new_id if isinstance(command, messages.SetDeviceId) else 0
    data = _data(command).ljust(DATA_LENGTH, b"\0")
    return Frame(join_identifier(kind, high, command.host_id, command.motor_id), data)


def _check_id(what: str, motor_id: int) -> None:
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise FieldError(f"{what}: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")


def _encode_operation_control(command: messages.OperationControl, model: MotorModel) -> Frame:
    for name in COMMAND_FIELDS:
        value = getattr(command, name)
        if not math.isfinite(value):
            raise FieldError(f"OperationControl.{name}: is {value}, expected a finite number")
    data = _WORDS.pack(
        to_signed(command.position, model.position),
        to_signed(command.velocity, model.velocity),
        to_unsigned(command.stiffness, model.stiffness),
        to_unsigned(command.damping, model.damping),
    )
    effort = to_signed(command.effort, model.effort)
    return Frame(FrameType.OPERATION_CONTROL << 24 | effort << 8 | command.motor_id, data)


def _data(command: messages.HostCommand) -> bytes:  # noqa: PLR0911 - one for each kind of data
    """Return what a command's frame carries; the rest is zeros."""
    match command:
        case messages.Stop():
            return bytes([command.clear_fault])
        case messages.ReadVersion():
            return VERSION_REQUEST
        case messages.SetZero():
            return b"\x01"
        case messages.SetDeviceId():
            _check_id("SetDeviceId.new_id", command.new_id)
        case messages.ReadParameter():
            return _parameter_data(command, bytes(PAYLOAD_LENGTH))
        case messages.WriteParameter():
            return _parameter_data(command, command.payload)
        case messages.SaveParameters():
            return _COUNT
        case (
            messages.SetActiveReport(is_on=setting)
            | messages.SetBaudRate(baud_rate=setting)
            | messages.SetProtocol(protocol=setting)
        ):
            return _COUNT[:6] + bytes([setting])
    return b""


def _parameter_data(command: messages.ReadParameter | messages.WriteParameter, payload: bytes) -> bytes:
    name = type(command).__name__
    if not 0 <= command.index <= 0xFFFF:
        raise FieldError(f"{name}.index: is {command.index}, expected 0 to 0xFFFF")
    if len(payload) != PAYLOAD_LENGTH:
        raise FieldError(f"{name}.payload: has {len(payload)} bytes, expected {PAYLOAD_LENGTH}")
    return _INDEX.pack(command.index) + b"\0\0" + payload


def decode_command(
    frame: Frame, motor_id: int, model: MotorModel
) -> messages.Command | messages.Ignored | messages.Malformed:
    """Return what a motor with this id is told by a frame; never raises.

    Frames that other hosts send are taken as well: no data in type 0, 3 and 4, one byte in type 6, anything in type 22,
    and any last byte in types 23 to 25.
    """
    if reason := _another_protocol(frame):
        return messages.Ignored(reason)
    parts = split_identifier(frame.arbitration_id)
    if parts.destination != motor_id:
        return messages.Ignored(messages.IgnoredReason.UNKNOWN_DEVICE, parts.destination)
    if parts.type == FrameType.OPERATION_CONTROL:
        return _decode_operation_control(frame, motor_id, model)
    return _decode_other(frame.data, parts, motor_id)


def _another_protocol(frame: Frame) -> messages.IgnoredReason | None:
    """Return why a frame is none of this protocol's; None: it may be."""
    if frame.is_error:
        return messages.IgnoredReason.ERROR_FRAME
    if frame.is_remote:
        return messages.IgnoredReason.REMOTE_FRAME
    return None if frame.is_extended else messages.IgnoredReason.STANDARD_ID


def _decode_operation_control(
    frame: Frame, motor_id: int, model: MotorModel
) -> messages.OperationControl | messages.Malformed:
    if len(frame.data) != DATA_LENGTH:
        return messages.Malformed(motor_id, f"operation control with {len(frame.data)} bytes, expected {DATA_LENGTH}")
    position, velocity, stiffness, damping = _WORDS.unpack(frame.data)
    return messages.OperationControl(
        motor_id,
        from_signed(position, model.position),
        from_signed(velocity, model.velocity),
        from_signed(frame.arbitration_id >> 8 & 0xFFFF, model.effort),
        from_unsigned(stiffness, model.stiffness),
        from_unsigned(damping, model.damping),
    )


_BAUD_RATES = frozenset(int(rate) for rate in messages.BaudRate)
_PROTOCOLS = frozenset(int(protocol) for protocol in messages.Protocol)
_LEAST_BYTES: dict[int, int] = dict(_TYPES.values())


def _decode_other(  # noqa: PLR0911, PLR0912 - one case for each command
    data: bytes, parts: Identifier, motor_id: int
) -> messages.Command | messages.Ignored | messages.Malformed:
    host = parts.low
    least = _LEAST_BYTES.get(parts.type)
    if least is None:
        return messages.Ignored(messages.IgnoredReason.UNKNOWN_TYPE, motor_id)
    if not least <= len(data) <= DATA_LENGTH:
        return messages.Malformed(
            motor_id, f"type {parts.type} with {len(data)} bytes, expected {least} to {DATA_LENGTH}"
        )
    match parts.type:
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
        case FrameType.SET_BAUD_RATE if data[6] in _BAUD_RATES:
            return messages.SetBaudRate(motor_id, messages.BaudRate(data[6]), host_id=host)
        case FrameType.SET_PROTOCOL if data[6] in _PROTOCOLS:
            return messages.SetProtocol(motor_id, messages.Protocol(data[6]), host_id=host)
        case _:
            return messages.Malformed(motor_id, f"type {parts.type} with a setting that is none: {data.hex(' ')}")


_SIGNED = 3
"""The first fields, which have a sign."""
_EFFORT = 2


class RobstrideEncoder:
    """Encodes for motors in a fixed order, like `encode_command`, bit for bit."""

    def __init__(self, motor_ids: Sequence[int], models: Sequence[MotorModel]) -> None:
        """Precompute the ranges; a `FieldError` if an id is not one of 1 to 127."""
        for motor_id in motor_ids:
            _check_id("OperationControl.motor_id", motor_id)
        self._identifiers = [FrameType.OPERATION_CONTROL << 24 | motor_id for motor_id in motor_ids]
        self._upper = np.array([[getattr(model, name) for model in models] for name in COMMAND_FIELDS])
        self._lower = np.where(np.arange(len(COMMAND_FIELDS))[:, None] < _SIGNED, -self._upper, 0.0)

    def encode(self, values: FloatArray) -> EncodedFrames:
        """See `FrameEncoder`; a value that is not finite is a `FieldError`."""
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            motor_id = self._identifiers[column] & 0xFF
            value = values[row, column]
            raise FieldError(
                f"OperationControl.{COMMAND_FIELDS[row]}: is {value} for motor {motor_id}, expected a finite number"
            )
        clipped = np.clip(values, self._lower, self._upper)
        scaled = clipped / self._upper
        scaled[:_SIGNED] = (scaled[:_SIGNED] + 1.0) * SIGNED_STEPS
        scaled[_SIGNED:] *= UNSIGNED_STEPS
        raw = scaled.astype(np.uint16)  # truncates, as the reference does
        efforts = raw[_EFFORT].tolist()
        data = raw[[0, 1, 3, 4]].T.astype(">u2").tobytes()
        frames = tuple(
            (i, 0, Frame(identifier | effort << 8, data[8 * i : 8 * i + 8]))
            for i, (identifier, effort) in enumerate(zip(self._identifiers, efforts, strict=True))
        )
        return EncodedFrames(frames, clipped != values)


# --- replies

VERSION_MARK = b"\x00\xc4\x56"
"""First bytes of a version reply. As a status they would mean -12.49 rad."""
_VERSION_END = len(VERSION_MARK) + 4
"""End of the version: with the frame in the Chinese manuals, a byte before its end in the English ones."""
_FAULTS = struct.Struct("<II")
_PARAMETER = struct.Struct("<Hxx4s")
_TEMPERATURE_STEP = 10
"""Steps in 1 °C."""
_MODES = tuple(MotorMode)
_STATUS_FAULTS = tuple(StatusFault(bits) for bits in range(64))
"""By number: looking them up is much quicker than making them, and every received status does."""

_REPLIES = frozenset({FrameType.STATUS, FrameType.FAULT_REPORT})
"""Types that only motors send."""
_BOTH = frozenset({FrameType.GET_DEVICE_ID, FrameType.READ_PARAMETER, FrameType.ACTIVE_REPORT})
"""Types of a command and of its reply; the destination tells which."""
_DEFINED = frozenset(int(kind) for kind in FrameType)
_NAMES = {
    FrameType.STATUS: "status",
    FrameType.ACTIVE_REPORT: "status",
    FrameType.FAULT_REPORT: "fault report",
    FrameType.READ_PARAMETER: "parameter reply",
    FrameType.GET_DEVICE_ID: "device-id reply",
}


def decode_reply(
    frame: Frame, models: Mapping[int, MotorModel], host_id: int
) -> messages.Reply | messages.Ignored | messages.Malformed:
    """Return what a received frame says to a host; never raises.

    Only its request tells a version for certain from a status that begins with the same three bytes: a motor at
    -12.49 rad that moves at a third of its velocity range. Such a frame is taken for a version, asked for or not: a
    status missed in that one spot ages a joint by a period, while a version taken for a position is a jump.

    Args:
        models: the configured motors by id; frames of others are ignored, but for `DeviceId`, so that scans hear all.
        host_id: the receiver's own; answers to other hosts are ignored.
    """
    if reason := _another_protocol(frame):
        return messages.Ignored(reason)
    parts = split_identifier(frame.arbitration_id)
    if parts.type in _REPLIES or (parts.type in _BOTH and parts.destination == host_id):
        return _decode_addressed(frame.data, parts, models, host_id)
    if parts.type == FrameType.GET_DEVICE_ID and parts.destination == BROADCAST_ID:
        return _decode_device_id(frame.data, parts)
    if parts.type not in _DEFINED:
        return messages.Ignored(messages.IgnoredReason.UNKNOWN_TYPE, parts.low)
    if parts.type in _BOTH and parts.low in models and parts.destination not in models:
        return messages.Ignored(messages.IgnoredReason.OTHER_HOST, parts.low)
    return messages.Ignored(messages.IgnoredReason.HOST_COMMAND, parts.destination)


def _decode_device_id(data: bytes, parts: Identifier) -> messages.DeviceId | messages.Malformed:
    return messages.DeviceId(parts.low, data) if len(data) == DATA_LENGTH else _bad_length(data, parts)


def _bad_length(data: bytes, parts: Identifier) -> messages.Malformed:
    name = _NAMES[FrameType(parts.type)]
    return messages.Malformed(parts.low, f"{name} with {len(data)} bytes, expected {DATA_LENGTH}")


def _decode_addressed(  # noqa: PLR0911 - one for each kind of reply
    data: bytes, parts: Identifier, models: Mapping[int, MotorModel], host_id: int
) -> messages.Reply | messages.Ignored | messages.Malformed:
    kind, high, motor_id, destination = parts
    if destination != host_id:
        return messages.Ignored(messages.IgnoredReason.OTHER_HOST, motor_id)
    if kind == FrameType.GET_DEVICE_ID:
        return _decode_device_id(data, parts)
    model = models.get(motor_id)
    if model is None:
        return messages.Ignored(messages.IgnoredReason.UNKNOWN_DEVICE, motor_id)
    is_status = kind in (FrameType.STATUS, FrameType.ACTIVE_REPORT)
    if is_status and data.startswith(VERSION_MARK) and _VERSION_END <= len(data) <= DATA_LENGTH:
        first, second, third, fourth = data[len(VERSION_MARK) : _VERSION_END]
        return messages.Version(motor_id, destination, (first, second, third, fourth))
    if len(data) != DATA_LENGTH:
        return _bad_length(data, parts)
    if is_status:
        position, velocity, effort, temperature = _WORDS.unpack(data)
        return messages.Status(
            motor_id,
            destination,
            from_signed(position, model.position),
            from_signed(velocity, model.velocity),
            from_signed(effort, model.effort),
            temperature / _TEMPERATURE_STEP,
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
    """Return the frame of a motor's reply.

    Values of a status are cut off at the model's ranges; wrapping a position is the motor's business.
    """
    if isinstance(reply, messages.Status):
        return _encode_status(reply, model)
    if isinstance(reply, messages.DeviceId):
        return Frame(join_identifier(FrameType.GET_DEVICE_ID, 0, reply.motor_id, BROADCAST_ID), reply.uid)
    high, data = 0, b""
    match reply:
        case messages.FaultReport():
            kind, data = FrameType.FAULT_REPORT, _FAULTS.pack(int(reply.faults), int(reply.warnings))
        case messages.ParameterReply():
            kind, high = FrameType.READ_PARAMETER, 0 if reply.is_success else 1
            data = _PARAMETER.pack(reply.index, reply.payload)
        case messages.Version():
            # An enabled motor's mode bits are not documented here; those of a stopped one are zero.
            kind, data = FrameType.STATUS, (VERSION_MARK + bytes(reply.version)).ljust(DATA_LENGTH, b"\0")
    return Frame(join_identifier(kind, high, reply.motor_id, reply.host_id), data)


def _encode_status(status: messages.Status, model: MotorModel) -> Frame:
    data = _WORDS.pack(
        to_signed(status.position, model.position),
        to_signed(status.velocity, model.velocity),
        to_signed(status.effort, model.effort),
        min(max(round(status.temperature * _TEMPERATURE_STEP), 0), 0xFFFF),
    )
    kind = FrameType.ACTIVE_REPORT if status.is_report else FrameType.STATUS
    return Frame(join_identifier(kind, status.mode << 6 | status.faults, status.motor_id, status.host_id), data)
