"""Frames to replies, and back for the motors' side."""

from __future__ import annotations

import struct
from collections.abc import Mapping

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride.fields import (
    BROADCAST_ID,
    DATA_LENGTH,
    FaultBit,
    FrameType,
    Identifier,
    MotorMode,
    Scale,
    StatusFault,
    WarningBit,
    join_identifier,
    split_identifier,
)
from humanoid_sim.hardware.robstride.messages import (
    DeviceId,
    FaultReport,
    Ignored,
    IgnoredReason,
    Malformed,
    ParameterReply,
    Reply,
    Status,
    Version,
)
from humanoid_sim.robots.motors import MotorModel

VERSION_MARK = b"\x00\xc4\x56"
"""First bytes of a version reply. As a status they would mean -12.49 rad."""
_VERSION_END = len(VERSION_MARK) + 4
"""End of the version: with the frame in the Chinese manuals, a byte before its end in the English ones."""
_STATUS = struct.Struct(">HHHH")
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


def decode_reply(  # noqa: PLR0911 - one for each reason to ignore a frame
    frame: Frame,
    models: Mapping[int, MotorModel],
    host_id: int,
    *,
    scale: Scale = Scale.REFERENCE,
) -> Reply | Ignored | Malformed:
    """Return what a received frame says to a host; never raises.

    Only its request tells a version for certain from a status that begins with the same three bytes: a motor at
    -12.49 rad that moves at a third of its velocity range. Such a frame is taken for a version, asked for or not: a
    status missed in that one spot ages a joint by a period, while a version taken for a position is a jump.

    Args:
        models: the configured motors by id; frames of others are ignored, but for `DeviceId`, so that scans hear all.
        host_id: the receiver's own; answers to other hosts are ignored.
    """
    if frame.is_error:
        return Ignored(IgnoredReason.ERROR_FRAME)
    if frame.is_remote:
        return Ignored(IgnoredReason.REMOTE_FRAME)
    if not frame.is_extended:
        return Ignored(IgnoredReason.STANDARD_ID)
    parts = split_identifier(frame.arbitration_id)
    if parts.type in _REPLIES or (parts.type in _BOTH and parts.destination == host_id):
        return _decode_addressed(frame.data, parts, models, host_id, scale)
    if parts.type == FrameType.GET_DEVICE_ID and parts.destination == BROADCAST_ID:
        return _decode_device_id(frame.data, parts)
    if parts.type not in _DEFINED:
        return Ignored(IgnoredReason.UNKNOWN_TYPE, parts.low)
    if parts.type in _BOTH and parts.low in models and parts.destination not in models:
        return Ignored(IgnoredReason.OTHER_HOST, parts.low)
    return Ignored(IgnoredReason.HOST_COMMAND, parts.destination)


def _decode_device_id(data: bytes, parts: Identifier) -> DeviceId | Malformed:
    if len(data) != DATA_LENGTH:
        return _bad_length(data, parts)
    return DeviceId(parts.low, data)


def _bad_length(data: bytes, parts: Identifier) -> Malformed:
    return Malformed(parts.low, f"{_NAMES[FrameType(parts.type)]} with {len(data)} bytes, expected {DATA_LENGTH}")


def _decode_addressed(  # noqa: PLR0911 - one for each kind of reply
    data: bytes,
    parts: Identifier,
    models: Mapping[int, MotorModel],
    host_id: int,
    scale: Scale,
) -> Reply | Ignored | Malformed:
    kind, high, motor_id, destination = parts
    if destination != host_id:
        return Ignored(IgnoredReason.OTHER_HOST, motor_id)
    if kind == FrameType.GET_DEVICE_ID:
        return _decode_device_id(data, parts)
    model = models.get(motor_id)
    if model is None:
        return Ignored(IgnoredReason.UNKNOWN_DEVICE, motor_id)
    is_status = kind in (FrameType.STATUS, FrameType.ACTIVE_REPORT)
    if is_status and data.startswith(VERSION_MARK) and _VERSION_END <= len(data) <= DATA_LENGTH:
        first, second, third, fourth = data[len(VERSION_MARK) : _VERSION_END]
        return Version(motor_id, destination, (first, second, third, fourth))
    if len(data) != DATA_LENGTH:
        return _bad_length(data, parts)
    if is_status:
        position, velocity, effort, temperature = _STATUS.unpack(data)
        return Status(
            motor_id,
            destination,
            scale.from_raw(position, model.position),
            scale.from_raw(velocity, model.velocity),
            scale.from_raw(effort, model.effort),
            temperature / _TEMPERATURE_STEP,
            _MODES[high >> 6],
            _STATUS_FAULTS[high & 0x3F],
            kind == FrameType.ACTIVE_REPORT,
        )
    if kind == FrameType.FAULT_REPORT:
        faults, warnings = _FAULTS.unpack(data)
        return FaultReport(motor_id, destination, FaultBit(faults), WarningBit(warnings))
    index, payload = _PARAMETER.unpack(data)
    return ParameterReply(motor_id, destination, index, payload, high == 0)


def encode_reply(reply: Reply, model: MotorModel, *, scale: Scale = Scale.REFERENCE) -> Frame:
    """Return the frame of a motor's reply.

    Values of a status are cut off at the model's ranges; wrapping a position is the motor's business.
    """
    if isinstance(reply, Status):
        return _encode_status(reply, model, scale)
    if isinstance(reply, DeviceId):
        return Frame(join_identifier(FrameType.GET_DEVICE_ID, 0, reply.motor_id, BROADCAST_ID), reply.uid)
    high, data = 0, b""
    match reply:
        case FaultReport():
            kind, data = FrameType.FAULT_REPORT, _FAULTS.pack(int(reply.faults), int(reply.warnings))
        case ParameterReply():
            kind, high = FrameType.READ_PARAMETER, 0 if reply.is_success else 1
            data = _PARAMETER.pack(reply.index, reply.payload)
        case Version():
            # An enabled motor's mode bits are not documented here; those of a stopped one are zero.
            kind, data = FrameType.STATUS, (VERSION_MARK + bytes(reply.version)).ljust(DATA_LENGTH, b"\0")
    return Frame(join_identifier(kind, high, reply.motor_id, reply.host_id), data)


def _encode_status(status: Status, model: MotorModel, scale: Scale) -> Frame:
    data = _STATUS.pack(
        scale.to_raw(status.position, model.position),
        scale.to_raw(status.velocity, model.velocity),
        scale.to_raw(status.effort, model.effort),
        min(max(round(status.temperature * _TEMPERATURE_STEP), 0), 0xFFFF),
    )
    kind = FrameType.ACTIVE_REPORT if status.is_report else FrameType.STATUS
    return Frame(join_identifier(kind, status.mode << 6 | status.faults, status.motor_id, status.host_id), data)
