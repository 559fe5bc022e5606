"""Run, test and deploy humanoid policies: one control stack in MuJoCo, on emulated motors and on the robot."""

__version__ = "0.1.0"
