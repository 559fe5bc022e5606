"""Messages between hosts and motors, without the encoding.

`host_id` is the host's own id; 0xFD in every example of the vendor. Motor ids are 1 to 127 (0x7F from the factory).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TypeAlias

from humanoid_sim.hardware.robstride.fields import FaultBit, MotorMode, StatusFault, WarningBit

DEFAULT_HOST_ID = 0xFD


@dataclass(frozen=True, slots=True)
class OperationControl:
    """Type 1, answered by a status: `torque = damping·(velocity - v) + stiffness·(position - p) + effort`.

    Values are in the motor frame and in rad, s and N·m. The frame has no room for a host id.
    """

    motor_id: int
    position: float
    velocity: float
    effort: float
    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class HostCommand:
    """Fields of every other command: the motor, and the host that asks."""

    motor_id: int
    host_id: int = field(default=DEFAULT_HOST_ID, kw_only=True)


@dataclass(frozen=True, slots=True)
class GetDeviceId(HostCommand):
    """Type 0, answered by `DeviceId`."""


@dataclass(frozen=True, slots=True)
class Enable(HostCommand):
    """Type 3, answered by a status."""


@dataclass(frozen=True, slots=True)
class Stop(HostCommand):
    """Type 4, answered by a status: the motor goes limp."""

    clear_fault: bool = False


@dataclass(frozen=True, slots=True)
class ReadVersion(HostCommand):
    """Type 4 with `00 C4`, answered by `Version`."""


@dataclass(frozen=True, slots=True)
class SetZero(HostCommand):
    """Type 6, answered by a status: here is position 0. Ignored in position mode PP."""


@dataclass(frozen=True, slots=True)
class SetDeviceId(HostCommand):
    """Type 7, at once, answered by `DeviceId` from the new id."""

    new_id: int


@dataclass(frozen=True, slots=True)
class ReadParameter(HostCommand):
    """Type 17, answered by `ParameterReply`."""

    index: int


@dataclass(frozen=True, slots=True)
class WriteParameter(HostCommand):
    """Type 18, answered by a status; lost at power-off unless saved."""

    index: int
    payload: bytes
    """4 bytes; `humanoid_sim.hardware.robstride.parameters` packs a value into them."""


@dataclass(frozen=True, slots=True)
class SaveParameters(HostCommand):
    """Type 22, answered by a status."""


@dataclass(frozen=True, slots=True)
class SetActiveReport(HostCommand):
    """Type 24: start or stop reports without being asked; newer firmware only."""

    is_on: bool


class BaudRate(IntEnum):
    """Bit rates that a motor can be set to, as the frame has them."""

    KBIT_1000 = 1
    KBIT_500 = 2
    KBIT_250 = 3
    KBIT_125 = 4


@dataclass(frozen=True, slots=True)
class SetBaudRate(HostCommand):
    """Type 23, after the next power-on, answered by `DeviceId`. It can make a motor unreachable: for emulation."""

    baud_rate: BaudRate


class Protocol(IntEnum):
    """Protocols that a motor can be set to, as the frame has them."""

    PRIVATE = 0
    CANOPEN = 1
    MIT = 2
    """With 11-bit identifiers."""


@dataclass(frozen=True, slots=True)
class SetProtocol(HostCommand):
    """Type 25, after the next power-on, answered by `DeviceId`. It can make a motor unreachable: for emulation."""

    protocol: Protocol


@dataclass(frozen=True, slots=True)
class Status:
    """Type 2, or type 24 where `is_report`. Values are in the motor frame and in rad, s and N·m."""

    motor_id: int
    host_id: int
    position: float
    """Runs cyclically within ±4π."""
    velocity: float
    effort: float
    temperature: float
    """°C, not below 0."""
    mode: MotorMode
    faults: StatusFault
    is_report: bool = False


@dataclass(frozen=True, slots=True)
class FaultReport:
    """Type 21. Both words zero: no fault."""

    motor_id: int
    host_id: int
    faults: FaultBit
    warnings: WarningBit


@dataclass(frozen=True, slots=True)
class ParameterReply:
    """Type 17."""

    motor_id: int
    host_id: int
    index: int
    payload: bytes
    """4 bytes, little-endian, left-aligned; without meaning unless `is_success`."""
    is_success: bool = True


@dataclass(frozen=True, slots=True)
class DeviceId:
    """Type 0, to everybody."""

    motor_id: int
    uid: bytes
    """8 bytes, the motor's microcontroller."""


@dataclass(frozen=True, slots=True)
class Version:
    """Answer to `ReadVersion`."""

    motor_id: int
    host_id: int
    version: tuple[int, int, int, int]
    """`(0, 2, 3, 6)` is firmware 0.2.3.6."""


class IgnoredReason(Enum):
    """Reason why a frame is not for this receiver."""

    STANDARD_ID = "standard_id"
    """11-bit: another protocol, or a motor that was switched to one."""
    UNKNOWN_TYPE = "unknown_type"
    HOST_COMMAND = "host_command"
    """A host's command: the echo of our own, or another master's."""
    UNKNOWN_DEVICE = "unknown_device"
    """A motor's, but none that is configured; on the motors' side, a command to another motor."""
    OTHER_HOST = "other_host"
    """A motor's answer to another host."""
    REMOTE_FRAME = "remote_frame"
    ERROR_FRAME = "error_frame"


@dataclass(frozen=True, slots=True)
class Ignored:
    """A frame that says nothing to this receiver."""

    reason: IgnoredReason
    motor_id: int | None = None
    """The motor that sent it, or that it was sent to in a host's command; none where the frame does not tell."""


@dataclass(frozen=True, slots=True)
class Malformed:
    """A frame of a configured motor, or for this motor, that cannot be read."""

    motor_id: int
    reason: str
    """Such as `status with 5 bytes, expected 8`."""


Command: TypeAlias = OperationControl | HostCommand
Reply: TypeAlias = Status | FaultReport | ParameterReply | DeviceId | Version
