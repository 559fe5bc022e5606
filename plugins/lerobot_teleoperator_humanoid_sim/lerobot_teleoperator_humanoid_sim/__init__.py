"""Hands of a humanoid_sim robot, led from the keyboard, as a teleoperator of LeRobot: `--teleop.type=humanoid_sim`."""

from lerobot_teleoperator_humanoid_sim.teleoperator import HumanoidSimTeleoperator, HumanoidSimTeleoperatorConfig

__all__ = ["HumanoidSimTeleoperator", "HumanoidSimTeleoperatorConfig"]
