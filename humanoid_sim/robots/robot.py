"""Interface of every robot to the control loop."""

from __future__ import annotations

from typing import Protocol

from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import MITCommand, MITState


class Robot(Protocol):
    """A robot's joints, in the joint frame."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names in the order of every per-joint array."""

    def activate(self) -> None:
        """Verify, configure and enable. Raises `RobotError` with the whole list of what is wrong."""

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the latest state, and one safety status per source."""

    def write(self, command: MITCommand) -> None:
        """Hand a command to every joint. In simulation this also advances physics by one control period."""

    def close(self) -> None:
        """Leave the robot without torque and release it. May be called twice."""
