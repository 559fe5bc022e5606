"""The DDS bridge: a session's topics for ROS 2 and Cyclone DDS, and commands for REMOTE from there."""

from humanoid_sim.frontends.dds.program import main

__all__ = ["main"]
