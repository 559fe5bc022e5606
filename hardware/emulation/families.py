"""Which firmware each motor of a robot has."""

from __future__ import annotations

from typing import Any

from humanoid_sim.hardware.emulation.interface import Firmware
from humanoid_sim.hardware.emulation.robstride_motor import RobstrideFirmware
from humanoid_sim.hardware.emulation.settings import EmulationSettings, motor_identities
from humanoid_sim.hardware.emulation.sito_motor import SitoFirmware
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import motor_model

__all__ = ["make_firmwares"]


def make_firmwares(description: RobotDescription, settings: EmulationSettings) -> tuple[Firmware[Any], ...]:
    """One per driven joint, in order.

    Raises:
        InputError: a model is unknown, or see `motor_identities`.
    """
    identities = iter(motor_identities(description, settings))
    made: list[Firmware[Any]] = []
    for joint in description.joints:
        motor = joint.motor
        if motor is None:
            continue
        model = motor_model(motor.model)
        if model.family == "sito":
            made.append(SitoFirmware(model, motor.can_id, is_deaf=settings.sito_deaf_until_enabled))
        else:
            made.append(RobstrideFirmware(next(identities), motor.can_id))
    return tuple(made)
