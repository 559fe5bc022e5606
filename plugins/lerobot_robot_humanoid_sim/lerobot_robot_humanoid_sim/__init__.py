"""A running humanoid_sim session as a robot of LeRobot: `--robot.type=humanoid_sim`."""

from lerobot_robot_humanoid_sim.camera import HumanoidSimCamera
from lerobot_robot_humanoid_sim.config import HumanoidSimCameraConfig, HumanoidSimConfig
from lerobot_robot_humanoid_sim.robot import HumanoidSim

__all__ = ["HumanoidSim", "HumanoidSimCamera", "HumanoidSimCameraConfig", "HumanoidSimConfig"]
