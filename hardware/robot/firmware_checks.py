"""Whether a motor's firmware is one that this adapter can drive."""

from __future__ import annotations

from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, firmware_of, model_name, version_text
from humanoid_sim.robots.motors import MotorModel

__all__ = ["firmware_problem", "firmware_warning"]


def firmware_problem(model: MotorModel, version: FirmwareVersion) -> str:
    """Why a motor with this firmware must not be driven as this model; empty when it may.

    A motor driven as another model would scale torque, velocity and gains wrongly.
    """
    found = model_name(version)
    if found != model.name:
        whose = f"is an {found}'s" if found else "is no known model's"
        return f"its firmware {version_text(version)} {whose}, the robot description has an {model.name} here"
    factor = firmware_of(model, version).gain_factor
    if factor != 1.0:
        return f"its firmware {version_text(version)} multiplies K_p and K_d by {factor:g}: update it"
    return ""


def firmware_warning(model: MotorModel, version: FirmwareVersion) -> str:
    """What an operator should know about this firmware; empty for nothing."""
    found = firmware_of(model, version).position_range
    if found == model.position:
        return ""
    return (
        f"its firmware {version_text(version)} counts ±{found:g} rad where frames are read as ±{model.position:.3f}: "
        f"angles are off by {100.0 * (model.position / found - 1.0):.1f} %"
    )
