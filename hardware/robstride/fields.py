"""Contents of the protocol's frames: the parts of a 29-bit identifier, a motor's mode and fault bits, scaled values.

Physical values become 16-bit fields in one of two conventions that are in use. `REFERENCE` (Actuator-Control,
robstride_dynamics, motorbridge) has 65534 steps: raw 32767 is exactly zero and 65535 is never sent. `MANUAL` (the
manuals and the vendor's samples) has 65535 steps and no raw value for zero. The two differ by 0 at raw 0, by half a
step in the middle and by one step at full scale. Everything here uses REFERENCE unless told otherwise, because a zero
effort and a zero velocity must arrive as zero where the same convention reads them; a motor that reads with MANUAL
takes a commanded 0 for half a step below it (2e-4 rad, 3e-4 N·m on an rs-02).

Both truncate, so that what is read back lies up to one step below what was sent. Gains have one convention only.
"""

from __future__ import annotations

import math
from enum import Enum, IntEnum, IntFlag
from typing import NamedTuple

BROADCAST_ID = 0xFE
"""Destination of a device-id reply."""
DATA_LENGTH = 8
"""Bytes in every frame that carries data."""


class FrameType(IntEnum):
    """Communication type, bits 28..24 of the identifier. 5, 8 to 16, 19, 20 and 26 to 31 are not defined."""

    GET_DEVICE_ID = 0
    OPERATION_CONTROL = 1
    STATUS = 2
    ENABLE = 3
    STOP = 4
    """Stop, clear faults and read the version, told apart by the data."""
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

    type: int
    """Bits 28..24: a `FrameType`, or a number without meaning."""
    high: int
    """Bits 23..16: mode and faults of a status, result of a parameter reply, high byte of an effort, a new id."""
    low: int
    """Bits 15..8: the sender's id, or the low byte of an effort."""
    destination: int
    """Bits 7..0."""


def split_identifier(arbitration_id: int) -> Identifier:
    """Return the parts of an identifier; never raises."""
    return Identifier(
        arbitration_id >> 24 & 0x1F, arbitration_id >> 16 & 0xFF, arbitration_id >> 8 & 0xFF, arbitration_id & 0xFF
    )


def join_identifier(kind: int, high: int, low: int, destination: int) -> int:
    """Return the 29-bit identifier with these parts."""
    return kind << 24 | high << 16 | low << 8 | destination


UNSIGNED_STEPS = 65535
SIGNED_STEPS = 32767
"""Steps from zero to full scale in the reference's convention."""


class Scale(Enum):
    """Convention of the signed fields: position, velocity and effort."""

    REFERENCE = "reference"
    MANUAL = "manual"

    def to_raw(self, value: float, limit: float) -> int:
        """Return the raw field of a finite value, cut off at ±limit: 0 to 65534 (REFERENCE) or 65535 (MANUAL)."""
        value = min(max(value, -limit), limit)
        if self is Scale.REFERENCE:
            return math.trunc((value / limit + 1.0) * SIGNED_STEPS)
        return math.trunc((value + limit) * UNSIGNED_STEPS / (2.0 * limit))

    def from_raw(self, raw: int, limit: float) -> float:
        """Return the value of a raw field, 0 to 65535. In REFERENCE the last step lies beyond the limit by 0.003 %."""
        if self is Scale.REFERENCE:
            return (raw / SIGNED_STEPS - 1.0) * limit
        return (2.0 * raw / UNSIGNED_STEPS - 1.0) * limit


def to_unsigned(value: float, limit: float) -> int:
    """Encode a finite gain, cut off at 0 and at the limit, in 0 to 65535. A gain below one step becomes 0."""
    return math.trunc(min(max(value, 0.0), limit) / limit * UNSIGNED_STEPS)


def from_unsigned(raw: int, limit: float) -> float:
    """Return the gain of a raw field, 0 to 65535."""
    return raw * limit / UNSIGNED_STEPS


class MotorMode(IntEnum):
    """Bits 23..22 of a status frame's identifier."""

    RESET = 0
    """Not enabled: after power-on, a stop, a CAN timeout, a brown-out."""
    CALIBRATION = 1
    RUN = 2
    """Enabled: executes commands."""
    UNDEFINED = 3


class StatusFault(IntFlag):
    """Bits 21..16 of a status frame's identifier. Overvoltage has none: only a fault report shows it."""

    UNDERVOLTAGE = 1 << 0
    PHASE_OVERCURRENT = 1 << 1
    """The manual's; the reference calls it "gate driver"."""
    MOTOR_OVERTEMPERATURE = 1 << 2
    ENCODER_FAULT = 1 << 3
    STALL_OVERLOAD = 1 << 4
    UNCALIBRATED = 1 << 5


class FaultBit(IntFlag):
    """The fault word of a fault report (type 21), and of the function-code parameter that holds it."""

    MOTOR_OVERTEMPERATURE = 1 << 0
    DRIVER_CHIP = 1 << 1
    UNDERVOLTAGE = 1 << 2
    """Below 12 V."""
    OVERVOLTAGE = 1 << 3
    """Above 60 V."""
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
    """Names of the set bits in rising order, such as `stall_overload`; a bit without a name is `bit13`."""
    kind = type(flags)
    names = {int(member): str(member.name).lower() for member in kind}
    bits = (1 << shift for shift in range(int(flags).bit_length()))
    return tuple(names.get(bit, f"bit{bit.bit_length() - 1}") for bit in bits if int(flags) & bit)
