"""A robot without physics."""

from __future__ import annotations

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription

_OK = SafetyStatus(source="loopback")


class LoopbackRobot:
    """State = last command: position, velocity and feed-forward effort come back as they were written.

    The clock advances by one control period per `write` and never goes back. The IMU is upright and at rest.
    """

    def __init__(self, description: RobotDescription, *, control_period: float | None = None) -> None:
        """Start at the description's initial position; `control_period` in s, None for the simulation's."""
        frequency = description.simulation.control_frequency
        self._control_period = 1.0 / frequency if control_period is None else control_period
        self._description = description
        self._writes = 0
        self._is_closed = False
        self._command = self._initial_command()

    @property
    def joints(self) -> tuple[str, ...]:
        """See `Robot.joints`."""
        return self._description.joint_names

    @property
    def description(self) -> RobotDescription:
        """What this robot was built from."""
        return self._description

    @property
    def control_period(self) -> float:
        """s, by which one `write` advances the clock."""
        return self._control_period

    @property
    def time(self) -> float:
        """s, the robot's clock."""
        return self._writes * self._control_period

    def activate(self) -> None:
        """Back to the initial position, at the present time. Raises `RobotError` if the robot is closed."""
        if self._is_closed:
            raise RobotError(f"{self._description.name}: the looped-back robot is closed")
        self._command = self._initial_command()

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """The last command as a state, and an OK."""
        state = MITState(
            time=self.time,
            joint_position=self._command.position,
            joint_velocity=self._command.velocity,
            joint_effort=self._command.effort,
            joint_age=np.zeros(self._description.joint_count),
            imu_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
            imu_angular_velocity=np.zeros(3),
            imu_linear_acceleration=np.array([0.0, 0.0, 9.81]),
        )
        return state, (_OK,)

    def write(self, command: MITCommand) -> None:
        """Take a command, shape (n,). Raises `RobotError` if it is for another number of joints, or closed."""
        n = self._description.joint_count
        if command.position.shape != (n,):
            raise RobotError(f"{self._description.name}: command has shape {command.position.shape}, expected ({n},)")
        if self._is_closed:
            raise RobotError(f"{self._description.name}: the looped-back robot is closed")
        self._command = command
        self._writes += 1

    def close(self) -> None:
        """Refuse further commands. May be called twice."""
        self._is_closed = True

    def _initial_command(self) -> MITCommand:
        zeros = np.zeros(self._description.joint_count)
        return MITCommand(np.array(self._description.initial_position), zeros, zeros, zeros, zeros)
