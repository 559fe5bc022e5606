"""Motors under control: their joints' state, their safety, and commands to them."""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.hardware.imu.interface import ImuReading
from humanoid_sim.hardware.robot.activation import Prepared
from humanoid_sim.hardware.robot.limiter import CommandEncoder
from humanoid_sim.hardware.robot.link import Link
from humanoid_sim.hardware.robot.settings import AdapterSettings
from humanoid_sim.hardware.robot.tracker import JointReadings, JointTracker
from humanoid_sim.hardware.robot.watch import SafetyWatch
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray, MITCommand, MITState

__all__ = ["MotorControl", "robot_state"]

_BAD_COMMAND = SafetyStatus(
    SafetyLevel.CRITICAL, SafetyFlag.NONE, "host", "a command was not finite and was replaced by damping"
)
"""The status about this program's own commands."""


class MotorControl:
    """What lasts from one activation to the next. Nothing here waits or raises for what happens on a bus."""

    def __init__(self, settings: AdapterSettings, link: Link, prepared: Prepared) -> None:
        """Begin with motors that were prepared; commands are sent once they are enabled.

        Args:
            settings: the robot's.
            link: its open channels.
            prepared: what was found about the motors.
        """
        wiring = settings.wiring
        self._settings = settings
        self._link = link
        self._tracker = JointTracker(wiring, prepared.turns)
        self._joints = self._tracker.update(link.table.readings())
        self._watch: SafetyWatch | None = None
        self._bad_command = -math.inf
        self.encoder = CommandEncoder(wiring, len(link.channels), 2.0 * settings.control_period)
        self.reporting = prepared.reporting
        """Joints whose motors send active reports."""
        self.last_command: MITCommand | None = None
        """The last that was sent."""
        self.refused = 0
        """Commands that were not sent as they were: not enabled, or not finite."""
        zeros = np.zeros(wiring.count)
        self._damped = MITCommand(zeros, zeros, zeros, zeros, settings.damping)

    @property
    def is_enabled(self) -> bool:
        """Whether the motors were enabled, and not disabled since by this program."""
        return self._watch is not None

    @property
    def jumped(self) -> frozenset[str]:
        """Joints whose position jumped."""
        names = self._settings.wiring.names
        return frozenset(names[i] for i in np.flatnonzero(self._tracker.jumped))

    def enable(self, now: float) -> None:
        """The motors are enabled as of `now`, s, robot's clock."""
        self._link.begin()
        self._watch = SafetyWatch(self._settings, self._link.table, self._link.channels, since=now)

    def disable(self) -> None:
        """The motors are disabled: nothing more is sent."""
        self._watch = None

    def read(self) -> JointReadings:
        """The joints' latest state."""
        self._joints = self._tracker.update(self._link.table.readings())
        return self._joints

    def statuses(self, now: float, age: FloatArray) -> tuple[SafetyStatus, ...]:
        """One status per channel, and one about this program's commands if one was bad; none before enabling.

        Args:
            now: s, robot's clock.
            age: shape (n,), s since each joint was heard.
        """
        if self._watch is None:
            return ()
        statuses = self._watch.statuses(now, age, self._tracker)
        return statuses if now - self._bad_command > self._settings.rx_timeout else (*statuses, _BAD_COMMAND)

    def write(self, command: MITCommand, now: float) -> None:
        """Hand a command, shape (n,), to every motor. One that is not finite is replaced by damping."""
        if self._watch is None:
            self.refused += 1
            return
        if not command.is_finite():
            self.refused += 1
            self._bad_command = now
            command = self._damped
        self.last_command = command
        batches = self.encoder.encode(command, self._joints, self._tracker)
        for channel, batch in zip(self._link.channels, batches, strict=True):
            self._link.table.count_commands(batch)
            channel.send(batch)

    def damp(self, now: float) -> None:
        """DAMPING's command, which needs no state."""
        self.write(self._damped, now)


def robot_state(now: float, joints: JointReadings, age: FloatArray, imu: ImuReading) -> MITState:
    """What the control stack reads.

    Args:
        now: s, robot's clock.
        joints: in the joint frame.
        age: shape (n,), s since each joint was heard.
        imu: what it last felt.
    """
    return MITState(
        time=now,
        joint_position=joints.position,
        joint_velocity=joints.velocity,
        joint_effort=joints.effort,
        joint_age=age,
        imu_quaternion=imu.quaternion,
        imu_angular_velocity=imu.angular_velocity,
        imu_linear_acceleration=imu.linear_acceleration,
    )
