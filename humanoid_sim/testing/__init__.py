"""Fuzz controllers, robot settings and control stacks with Hypothesis (extra `testing`); see docs/testing.md."""

from humanoid_sim.errors import needing

with needing("hypothesis", "testing", "humanoid_sim.testing"):
    import hypothesis as _hypothesis  # noqa: F401

from humanoid_sim.testing.fuzz import DEFAULT_SETTINGS, fuzz_controller, fuzz_stack, robot_stack
from humanoid_sim.testing.machine import StackMachine
from humanoid_sim.testing.properties import SafetyViolationError

__all__ = ["DEFAULT_SETTINGS", "SafetyViolationError", "StackMachine", "fuzz_controller", "fuzz_stack", "robot_stack"]
