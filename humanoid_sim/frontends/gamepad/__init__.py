"""A gamepad for a running session: buttons ask for modes, sticks command a velocity."""

from humanoid_sim.frontends.gamepad.program import GamepadConfig, main

__all__ = ["GamepadConfig", "main"]
