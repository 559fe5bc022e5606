"""The way in for remote commands: checked when they arrive, stamped on the robot's clock, never waited for."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import RemoteCommand
from humanoid_sim.mit import MITCommand

__all__ = ["RemoteInbox"]


class RemoteInbox:
    """Holds the latest accepted command. One thread puts, the control thread takes."""

    def __init__(self, joints: tuple[str, ...], clock: Callable[[], float]) -> None:
        """Prepare an inbox.

        Args:
            joints: the robot's joints; a command must name them in this order.
            clock: the robot's clock, s.
        """
        self._joints = joints
        self._clock = clock
        self._latest: RemoteCommand | None = None
        self.accepted = 0
        self.rejected = 0

    def put(self, joint_names: Sequence[str], command: MITCommand) -> None:
        """Accept a command; its arrival time is now, whatever its sender's clock says.

        Raises:
            FieldError: if the joint names or their order differ, or the command is not one finite value per joint and
                field, its gains not negative.
        """
        problem = self._problem(tuple(joint_names), command)
        if problem:
            self.rejected += 1
            raise FieldError(f"remote {problem}" if problem.startswith("command") else f"remote command: {problem}")
        self._latest = RemoteCommand(command, self._clock())
        self.accepted += 1

    def latest(self) -> RemoteCommand | None:
        """The latest accepted command."""
        return self._latest

    def _problem(self, joint_names: tuple[str, ...], command: MITCommand) -> str:
        if joint_names != self._joints:
            given = ", ".join(joint_names) or "missing"
            return f"joint_names are {given}, expected {', '.join(self._joints)} in this order"
        return command_problem(command, self._joints)
