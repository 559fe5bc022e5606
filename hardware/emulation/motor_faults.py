"""Faults of the scope `motor`: what sets in, and what it is like afterwards."""

from __future__ import annotations

from humanoid_sim.hardware.emulation.motors import Motors
from humanoid_sim.hardware.robstride.frames import Frame

__all__ = ["begin_motor_fault", "end_motor_fault"]


def begin_motor_fault(motors: Motors, motor: int, kind: str, amount: float) -> None:
    """A fault sets in. Its value is in `amount`."""
    conditions = motors.conditions[motor]
    match kind:
        case "silent":
            conditions.is_silent = True
        case "unplugged":
            motors.set_power(motor, False)
        case "reset":
            motors.fall_back(motor)
        case "over_temperature":
            conditions.temperature = amount
        case "under_voltage" | "over_voltage":
            conditions.voltage = amount
        case "overcurrent":
            conditions.overcurrent = True
        case "stalled":
            conditions.overloaded = True
            motors.plant.jam(motor, True)
        case "encoder_fault":
            conditions.encoder_fault = True
        case "encoder_jump":
            motors.jump(motor, amount)
    motors.look()


def end_motor_fault(motors: Motors, motor: int, kind: str, amount: float) -> tuple[Frame, ...]:
    """The cause is gone; what the firmware has latched stays. The frames that the motor sends about it."""
    conditions = motors.conditions[motor]
    announcement: tuple[Frame, ...] = ()
    match kind:
        case "silent":
            conditions.is_silent = False
        case "unplugged":
            announcement = motors.set_power(motor, True)
        case "over_temperature":
            conditions.temperature = None
        case "under_voltage" | "over_voltage":
            conditions.voltage = None
        case "overcurrent":
            conditions.overcurrent = False
        case "stalled":
            conditions.overloaded = False
            motors.plant.jam(motor, False)
        case "encoder_fault":
            conditions.encoder_fault = False
        case "encoder_jump":
            motors.jump(motor, -amount)
    motors.look()
    return announcement
