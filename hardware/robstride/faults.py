"""What a motor says about itself: its mode and its fault bits."""

from __future__ import annotations

from enum import IntEnum, IntFlag

__all__ = ["FaultBit", "MotorMode", "StatusFault", "WarningBit", "flag_names"]


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
