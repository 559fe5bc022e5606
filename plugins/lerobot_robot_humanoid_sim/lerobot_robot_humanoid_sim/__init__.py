"""A running humanoid_sim session as a robot of LeRobot: `--robot.type=humanoid_sim`."""

from lerobot_robot_humanoid_sim.robot import HumanoidSim, HumanoidSimConfig

__all__ = ["HumanoidSim", "HumanoidSimConfig"]
