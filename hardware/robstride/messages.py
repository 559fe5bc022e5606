"""Messages between hosts and motors, and the parts of their frames: identifiers, mode and fault bits, scaled values.

`host_id` is the host's own id; 0xFD in every example of the vendor. Motor ids are 1 to 127 (0x7F from the factory).
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeAlias

import msgspec

DEFAULT_HOST_ID = 0xFD
BROADCAST_ID = 0xFE  # destination of a device-id reply


class FrameType(IntEnum):
    """Communication type, bits 28..24 of the identifier; the others are not defined."""

    GET_DEVICE_ID = 0
    OPERATION_CONTROL = 1
    STATUS = 2
    ENABLE = 3
    STOP = 4  # stop, clear faults or read the version; the data says which
    SET_ZERO = 6
    SET_DEVICE_ID = 7
    READ_PARAMETER = 17
    WRITE_PARAMETER = 18
    FAULT_REPORT = 21
    SAVE_PARAMETERS = 22
    SET_BAUD_RATE = 23
    ACTIVE_REPORT = 24
    SET_PROTOCOL = 25


class Identifier(NamedTuple):
    """The parts of a 29-bit identifier."""

    type: int  # bits 28..24: a `FrameType`, or a number without meaning
    high: int  # bits 23..16: mode and faults of a status, a reply's result, high byte of an effort, a new id
    low: int  # bits 15..8: the sender's id, or the low byte of an effort
    destination: int  # bits 7..0


def split_identifier(arbitration_id: int) -> Identifier:
    """Return the parts of an identifier; never raises."""
    return Identifier(
        arbitration_id >> 24 & 0x1F, arbitration_id >> 16 & 0xFF, arbitration_id >> 8 & 0xFF, arbitration_id & 0xFF
    )


def join_identifier(kind: int, high: int, low: int, destination: int) -> int:
    """Return the 29-bit identifier with these parts."""
    return kind << 24 | high << 16 | low << 8 | destination


class MotorMode(IntEnum):
    """Bits 23..22 of a status frame's identifier."""

    RESET = 0  # not enabled: after power-on, a stop, a CAN timeout, a brown-out
    CALIBRATION = 1
    RUN = 2  # enabled: executes commands
    UNDEFINED = 3


class StatusFault(IntFlag):
    """Bits 21..16 of a status frame's identifier. Overvoltage has none: only a fault report shows it."""

    UNDERVOLTAGE = 1 << 0
    PHASE_OVERCURRENT = 1 << 1  # the manual's; the reference calls it "gate driver"
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
    names = {int(member): str(member.name).lower() for member in type(flags)}
    bits = (1 << shift for shift in range(int(flags).bit_length()))
    return tuple(names.get(bit, f"bit{bit.bit_length() - 1}") for bit in bits if int(flags) & bit)


# Messages: motor frame, rad, s and N·m.


class Message(msgspec.Struct, frozen=True):
    """A message from or to a motor."""

    motor_id: int


class OperationControl(Message, frozen=True):
    """Type 1, answered by a status: `torque = damping·(velocity - v) + stiffness·(position - p) + effort`.

    The frame has no room for a host id.
    """

    position: float
    velocity: float
    effort: float
    stiffness: float
    damping: float


class HostCommand(Message, frozen=True, kw_only=True):
    """Fields of every other command: the motor, and the host that asks."""

    host_id: int = DEFAULT_HOST_ID


class GetDeviceId(HostCommand, frozen=True):
    """Type 0, answered by `DeviceId`."""


class Enable(HostCommand, frozen=True):
    """Type 3, answered by a status."""


class Stop(HostCommand, frozen=True):
    """Type 4, answered by a status: the motor goes limp."""

    clear_fault: bool = False


class ReadVersion(HostCommand, frozen=True):
    """Type 4 with `00 C4`, answered by `Version`."""


class SetZero(HostCommand, frozen=True):
    """Type 6, answered by a status: here is position 0. Ignored in position mode PP."""


class SetDeviceId(HostCommand, frozen=True):
    """Type 7, at once, answered by `DeviceId` from the new id."""

    new_id: int


class ReadParameter(HostCommand, frozen=True):
    """Type 17, answered by `ParameterReply`."""

    index: int


class WriteParameter(HostCommand, frozen=True):
    """Type 18, answered by a status; lost at power-off unless saved."""

    index: int
    payload: bytes  # 4 bytes, of `parameters.pack_value`


class SaveParameters(HostCommand, frozen=True):
    """Type 22, answered by a status."""


class SetActiveReport(HostCommand, frozen=True):
    """Type 24: start or stop reports without a request; newer firmware only."""

    is_on: bool


class Status(Message, frozen=True):
    """Type 2, or type 24 where `is_report`."""

    host_id: int
    position: float  # runs cyclically within ±4π
    velocity: float
    effort: float
    temperature: float  # °C, not below 0
    mode: MotorMode
    faults: StatusFault
    is_report: bool = False


class FaultReport(Message, frozen=True):
    """Type 21. Both words zero: no fault."""

    host_id: int
    faults: FaultBit
    warnings: WarningBit


class ParameterReply(Message, frozen=True):
    """Type 17."""

    host_id: int
    index: int
    payload: bytes  # 4 bytes, little-endian, left-aligned; without meaning unless `is_success`
    is_success: bool = True


class DeviceId(Message, frozen=True):
    """Type 0, to everybody."""

    uid: bytes  # 8 bytes, the motor's microcontroller


class Version(Message, frozen=True):
    """Answer to `ReadVersion`."""

    host_id: int
    version: tuple[int, int, int, int]  # `(0, 2, 3, 6)` is firmware 0.2.3.6


class Ignored(msgspec.Struct, frozen=True):
    """A frame that says nothing to this receiver.

    Reasons: `standard_id` (11 bits, another protocol), `unknown_type`, `host_command` (the echo of our own, or another
    master's), `unknown_device` (a motor that is not configured), `other_host`, `remote_frame`, `error_frame`.
    """

    reason: str


class Malformed(Message, frozen=True):
    """A frame of a configured motor, or for this motor, that cannot be read."""

    reason: str  # such as `status with 5 bytes, expected 8`


Command: TypeAlias = OperationControl | HostCommand
Reply: TypeAlias = Status | FaultReport | ParameterReply | DeviceId | Version
