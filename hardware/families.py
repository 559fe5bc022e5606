"""The families of motors that can be driven. A new one is a folder beside `robstride/`, and a line here.

A motor model's family stands in its row of `humanoid_sim.robots.motors`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["ADAPTERS", "adapter_of"]

ADAPTERS: Mapping[str, type[HardwareRobot]] = MappingProxyType({"robstride": HardwareRobot})
"""By family: what drives a robot of such motors."""


def adapter_of(description: RobotDescription) -> type[HardwareRobot]:
    """What drives this robot's motors. Joints without one, and models that nobody knows, are the adapter's to refuse.

    Raises:
        InputError: they are of several families.
    """
    models = {joint.motor.model for joint in description.joints if joint.motor is not None}
    families = sorted({MOTORS[model].family for model in models if model in MOTORS})
    if len(families) > 1:
        raise InputError(f"{description.name}: has motors of {' and '.join(families)}, expected one family")
    if families and families[0] not in ADAPTERS:
        raise InputError(f"{description.name}: {known_names('family with an adapter', families[0], ADAPTERS)}")
    return ADAPTERS[families[0]] if families else HardwareRobot
