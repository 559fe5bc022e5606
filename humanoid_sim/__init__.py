"""Run, test and deploy humanoid policies: one control stack in MuJoCo, on emulated motors and on the robot."""

from humanoid_sim.envs.registration import register_with_gymnasium

__version__ = "0.1.0"

register_with_gymnasium()
