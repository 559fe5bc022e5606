"""What the page tells of each motor and each bus, on hardware."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from humanoid_sim.messages import TickRecord
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS

__all__ = ["motor_table"]


def motor_table(
    description: RobotDescription, robot: Mapping[str, Any] | None, loads: Mapping[str, float], record: TickRecord
) -> dict[str, Any] | None:
    """Motors and buses, as JSON; None in simulation.

    Args:
        description: of the robot.
        robot: what the feed's status tells of it.
        loads: of the buses, 0 to 1.
        record: the newest tick.
    """
    if robot is None:
        return None
    temperature, faults = robot["temperature"], robot["faults"]
    ages = record.input.state.joint_age.tolist()
    motors = []
    for joint, age in zip(description.joints, ages, strict=True):
        model = MOTORS.get(joint.motor.model) if joint.motor is not None else None
        motors.append(
            {
                "name": joint.name,
                "temperature": temperature.get(joint.name),
                "warning": None if model is None else model.warning_temperature,
                "heard": age,
                "faults": faults.get(joint.name, []),
            }
        )
    buses = [{"name": channel["source"], "load": loads.get(channel["source"])} for channel in robot["channels"]]
    return {"motors": motors, "buses": buses}
