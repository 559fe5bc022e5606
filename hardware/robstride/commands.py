"""Commands to frames, and back for the motors' side."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride.fields import (
    DATA_LENGTH,
    SIGNED_STEPS,
    UNSIGNED_STEPS,
    FrameType,
    Identifier,
    Scale,
    from_unsigned,
    join_identifier,
    split_identifier,
    to_unsigned,
)
from humanoid_sim.hardware.robstride.messages import (
    BaudRate,
    Command,
    Enable,
    GetDeviceId,
    HostCommand,
    Ignored,
    IgnoredReason,
    Malformed,
    OperationControl,
    Protocol,
    ReadParameter,
    ReadVersion,
    SaveParameters,
    SetActiveReport,
    SetBaudRate,
    SetDeviceId,
    SetProtocol,
    SetZero,
    Stop,
    WriteParameter,
)
from humanoid_sim.hardware.robstride.parameters import PAYLOAD_LENGTH
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MotorModel

LARGEST_MOTOR_ID = 127
VERSION_REQUEST = b"\x00\xc4"
"""First bytes of a stop frame that asks for the version instead."""
_COUNT = bytes(range(1, 9))
"""Data of a save; the first six bytes also precede the setting in types 23 to 25, whose last byte is free."""
_TYPES: Mapping[type[HostCommand], tuple[FrameType, int]] = {
    GetDeviceId: (FrameType.GET_DEVICE_ID, 0),
    Enable: (FrameType.ENABLE, 0),
    Stop: (FrameType.STOP, 0),
    ReadVersion: (FrameType.STOP, 0),
    SetZero: (FrameType.SET_ZERO, 1),
    SetDeviceId: (FrameType.SET_DEVICE_ID, 0),
    ReadParameter: (FrameType.READ_PARAMETER, DATA_LENGTH),
    WriteParameter: (FrameType.WRITE_PARAMETER, DATA_LENGTH),
    SaveParameters: (FrameType.SAVE_PARAMETERS, 0),
    SetBaudRate: (FrameType.SET_BAUD_RATE, 7),
    SetActiveReport: (FrameType.ACTIVE_REPORT, 7),
    SetProtocol: (FrameType.SET_PROTOCOL, 7),
}
"""By command: its frame's type, and the bytes that a motor needs of it."""
_MIT = struct.Struct(">HHHH")
_INDEX = struct.Struct("<H")


def encode_command(command: Command, model: MotorModel, *, scale: Scale = Scale.REFERENCE) -> Frame:
    """Return the frame of a command. Values of `OperationControl` are cut off at the model's ranges.

    Raises:
        FieldError: an id is not one, or a value is not finite: the reference turns NaN into full negative scale.
    """
    _check_id("motor_id", command, command.motor_id)
    if isinstance(command, OperationControl):
        return _encode_operation_control(command, model, scale)
    if not 0 <= command.host_id <= 0xFF:
        raise FieldError(f"{type(command).__name__}.host_id: is {command.host_id}, expected 0 to 255")
    kind, _ = _TYPES[type(command)]
    high = command.new_id if isinstance(command, SetDeviceId) else 0
    data = _data(command).ljust(DATA_LENGTH, b"\0")
    return Frame(join_identifier(kind, high, command.host_id, command.motor_id), data)


def _check_id(field: str, command: Command | HostCommand, motor_id: int) -> None:
    if not 1 <= motor_id <= LARGEST_MOTOR_ID:
        raise FieldError(f"{type(command).__name__}.{field}: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")


def _encode_operation_control(command: OperationControl, model: MotorModel, scale: Scale) -> Frame:
    for name in ("position", "velocity", "effort", "stiffness", "damping"):
        value = getattr(command, name)
        if not math.isfinite(value):
            raise FieldError(f"OperationControl.{name}: is {value}, expected a finite number")
    data = _MIT.pack(
        scale.to_raw(command.position, model.position),
        scale.to_raw(command.velocity, model.velocity),
        to_unsigned(command.stiffness, model.stiffness),
        to_unsigned(command.damping, model.damping),
    )
    effort = scale.to_raw(command.effort, model.effort)
    return Frame(FrameType.OPERATION_CONTROL << 24 | effort << 8 | command.motor_id, data)


def _data(command: HostCommand) -> bytes:  # noqa: PLR0911 - one for each kind of data
    """Return what a command's frame carries; the rest is zeros."""
    match command:
        case Stop():
            return bytes([command.clear_fault])
        case ReadVersion():
            return VERSION_REQUEST
        case SetZero():
            return b"\x01"
        case SetDeviceId():
            _check_id("new_id", command, command.new_id)
        case ReadParameter():
            return _parameter_data(command, bytes(PAYLOAD_LENGTH))
        case WriteParameter():
            return _parameter_data(command, command.payload)
        case SaveParameters():
            return _COUNT
        case SetActiveReport(is_on=setting) | SetBaudRate(baud_rate=setting) | SetProtocol(protocol=setting):
            return _COUNT[:6] + bytes([setting])
    return b""


def _parameter_data(command: ReadParameter | WriteParameter, payload: bytes) -> bytes:
    name = type(command).__name__
    if not 0 <= command.index <= 0xFFFF:
        raise FieldError(f"{name}.index: is {command.index}, expected 0 to 0xFFFF")
    if len(payload) != PAYLOAD_LENGTH:
        raise FieldError(f"{name}.payload: has {len(payload)} bytes, expected {PAYLOAD_LENGTH}")
    return _INDEX.pack(command.index) + b"\0\0" + payload


def decode_command(
    frame: Frame, motor_id: int, model: MotorModel, *, scale: Scale = Scale.REFERENCE
) -> Command | Ignored | Malformed:
    """Return what a motor with this id is told by a frame; never raises.

    Frames that other hosts send are taken as well: no data in type 0, 3 and 4, one byte in type 6, anything in type 22,
    and any last byte in types 23 to 25.
    """
    if frame.is_error:
        return Ignored(IgnoredReason.ERROR_FRAME)
    if frame.is_remote:
        return Ignored(IgnoredReason.REMOTE_FRAME)
    if not frame.is_extended:
        return Ignored(IgnoredReason.STANDARD_ID)
    parts = split_identifier(frame.arbitration_id)
    if parts.destination != motor_id:
        return Ignored(IgnoredReason.UNKNOWN_DEVICE, parts.destination)
    if parts.type == FrameType.OPERATION_CONTROL:
        return _decode_operation_control(frame, motor_id, model, scale)
    return _decode_other(frame.data, parts, motor_id)


def _decode_operation_control(
    frame: Frame, motor_id: int, model: MotorModel, scale: Scale
) -> OperationControl | Malformed:
    if len(frame.data) != DATA_LENGTH:
        return Malformed(motor_id, f"operation control with {len(frame.data)} bytes, expected {DATA_LENGTH}")
    position, velocity, stiffness, damping = _MIT.unpack(frame.data)
    return OperationControl(
        motor_id,
        scale.from_raw(position, model.position),
        scale.from_raw(velocity, model.velocity),
        scale.from_raw(frame.arbitration_id >> 8 & 0xFFFF, model.effort),
        from_unsigned(stiffness, model.stiffness),
        from_unsigned(damping, model.damping),
    )


_BAUD_RATES = frozenset(int(rate) for rate in BaudRate)
_PROTOCOLS = frozenset(int(protocol) for protocol in Protocol)
_LEAST_BYTES: dict[int, int] = dict(_TYPES.values())


def _decode_other(  # noqa: PLR0911, PLR0912 - one case for each command
    data: bytes, parts: Identifier, motor_id: int
) -> Command | Ignored | Malformed:
    host = parts.low
    least = _LEAST_BYTES.get(parts.type)
    if least is None:
        return Ignored(IgnoredReason.UNKNOWN_TYPE, motor_id)
    if not least <= len(data) <= DATA_LENGTH:
        return Malformed(motor_id, f"type {parts.type} with {len(data)} bytes, expected {least} to {DATA_LENGTH}")
    match parts.type:
        case FrameType.GET_DEVICE_ID:
            return GetDeviceId(motor_id, host_id=host)
        case FrameType.ENABLE:
            return Enable(motor_id, host_id=host)
        case FrameType.STOP if data[:2] == VERSION_REQUEST:
            return ReadVersion(motor_id, host_id=host)
        case FrameType.STOP:
            return Stop(motor_id, data[:1] == b"\x01", host_id=host)
        case FrameType.SET_ZERO if data[0] == 1:
            return SetZero(motor_id, host_id=host)
        case FrameType.SET_DEVICE_ID:
            return SetDeviceId(motor_id, parts.high, host_id=host)
        case FrameType.READ_PARAMETER:
            return ReadParameter(motor_id, _INDEX.unpack_from(data)[0], host_id=host)
        case FrameType.WRITE_PARAMETER:
            return WriteParameter(motor_id, _INDEX.unpack_from(data)[0], data[4:8], host_id=host)
        case FrameType.SAVE_PARAMETERS:
            return SaveParameters(motor_id, host_id=host)
        case FrameType.ACTIVE_REPORT if data[6] <= 1:
            return SetActiveReport(motor_id, data[6] == 1, host_id=host)
        case FrameType.SET_BAUD_RATE if data[6] in _BAUD_RATES:
            return SetBaudRate(motor_id, BaudRate(data[6]), host_id=host)
        case FrameType.SET_PROTOCOL if data[6] in _PROTOCOLS:
            return SetProtocol(motor_id, Protocol(data[6]), host_id=host)
        case _:
            return Malformed(motor_id, f"type {parts.type} with a setting that is none: {data.hex(' ')}")


_FIELDS = ("position", "velocity", "effort", "stiffness", "damping")
_SIGNED = 3
"""The first fields, which have a sign."""
_EFFORT = 2


@dataclass(frozen=True, slots=True, eq=False)
class EncodedCommands:
    """Frames, and what did not fit into them."""

    frames: tuple[Frame, ...]
    """One per motor, in the encoder's order."""
    saturated: npt.NDArray[np.bool_]
    """Shape (5, motors): whether position, velocity, effort, stiffness or damping was cut off."""


class OperationControlEncoder:
    """Encodes like `encode_command` in the reference's convention, bit for bit, for motors in a fixed order."""

    def __init__(self, motor_ids: Sequence[int], models: Sequence[MotorModel]) -> None:
        """Precompute the ranges.

        Raises:
            FieldError: an id is not one of 1 to 127.
        """
        for motor_id in motor_ids:
            if not 1 <= motor_id <= LARGEST_MOTOR_ID:
                raise FieldError(f"OperationControl.motor_id: is {motor_id}, expected 1 to {LARGEST_MOTOR_ID}")
        self._identifiers = [FrameType.OPERATION_CONTROL << 24 | motor_id for motor_id in motor_ids]
        self._upper = np.array([[getattr(model, name) for model in models] for name in _FIELDS])
        self._lower = np.where(np.arange(len(_FIELDS))[:, None] < _SIGNED, -self._upper, 0.0)

    def encode(self, values: FloatArray) -> EncodedCommands:
        """Return the frames of all motors.

        Args:
            values: shape (5, motors), motor frame: position rad, velocity rad/s, effort N·m, stiffness N·m/rad,
                damping N·m·s/rad.

        Raises:
            FieldError: a value is not finite.
        """
        if not np.isfinite(values).all():
            row, column = np.argwhere(~np.isfinite(values))[0]
            motor_id = self._identifiers[column] & 0xFF
            value = values[row, column]
            raise FieldError(
                f"OperationControl.{_FIELDS[row]}: is {value} for motor {motor_id}, expected a finite number"
            )
        clipped = np.clip(values, self._lower, self._upper)
        scaled = clipped / self._upper
        scaled[:_SIGNED] = (scaled[:_SIGNED] + 1.0) * SIGNED_STEPS
        scaled[_SIGNED:] *= UNSIGNED_STEPS
        raw = scaled.astype(np.uint16)  # truncates, as the reference does
        efforts = raw[_EFFORT].tolist()
        data = raw[[0, 1, 3, 4]].T.astype(">u2").tobytes()
        frames = tuple(
            Frame(identifier | effort << 8, data[8 * i : 8 * i + 8])
            for i, (identifier, effort) in enumerate(zip(self._identifiers, efforts, strict=True))
        )
        return EncodedCommands(frames, clipped != values)
