"""One motor on a bench, enabled for a moment."""

from __future__ import annotations

from collections.abc import Collection
from typing import Self

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT, enable_motors, examine, make_ready, stop_motors
from humanoid_sim.hardware.robstride.fields import MotorMode, flag_names
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.messages import OperationControl, Status
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import command_motor, read_value, write_value
from humanoid_sim.mit import MITCommand, bounded_position

_PERIOD = 0.01
"""s between commands to an enabled motor."""


class EnabledMotor:
    """A context in which a motor executes commands; it is limp at first, and stopped at the end whatever happens."""

    def __init__(
        self,
        channels: RobstrideLink,
        motor: int = 0,
        *,
        torque: float | None = None,
        period: float = _PERIOD,
        accepted_firmware: Collection[str] = (),
    ) -> None:
        """Nothing is sent yet; the channels must know the motor's model.

        Args:
            channels: open.
            motor: its index.
            torque: N·m that it may exert: its torque limit meanwhile, and the bound of what commands ask for. None: no
                torque will be asked for, see `identify`.
            period: s between commands.
            accepted_firmware: versions that no document mentions and the operator accepts all the same.
        """
        self._channels = channels
        self._motor = motor
        self._torque = torque
        self._period = period
        self._accepted_firmware = accepted_firmware
        self._motor_id = channels.motors.motor_id[motor]
        self._who = channels.motors.names[motor]
        self._old: dict[str, float | None] = {}
        self.warnings: tuple[str, ...] = ()
        """Findings that did not keep it from being enabled, one line each."""
        self.status: Status | None = None
        """The latest."""

    def __enter__(self) -> Self:
        """Enable the motor, after every check that a session makes.

        Raises:
            SilentMotorError: it does not answer.
            RobotError: another host drives it, it is another motor than expected or in another run mode, has no CAN
                timeout, or reports a fault.
        """
        channels, joints, checks = self._channels, [self._motor], CheckList(answered=self._accepted_firmware)
        examine(channels, joints, checks, takes_over=False, is_limp=self._torque is None)
        checks.refuse_questions()
        for name in ("canTimeout",) if self._torque is None else ("canTimeout", "limit_torque"):
            self._old[name] = read_value(channels, PARAMETERS[name], self._motor)
        try:
            make_ready(channels, joints, CAN_TIMEOUT, checks, takes_over=False, torque=self._torque)
            channels.check(checks)
            checks.refuse()
            enable_motors(channels.requests, joints, CAN_TIMEOUT, checks)
            checks.refuse()
        except BaseException:
            self._stop()
            raise
        self.warnings = checks.warnings
        sample = channels.table.slots[self._motor].sample
        self.status = None if sample is None else sample.status
        return self

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Status:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; the status that follows.

        As the adapter does with a robot's, it moves a position that would ask for more torque than allowed.

        Raises:
            SilentMotorError: none follows.
            RobotError: the motor is no longer enabled, reports a fault, or another host commands it too.
        """
        command = OperationControl(
            self._motor_id, self._bounded(position, velocity, stiffness, damping), velocity, 0.0, stiffness, damping
        )
        self.status = status = command_motor(self._channels, command, self._motor)
        checks = CheckList()
        self._channels.check(checks)
        if status.faults:
            checks.problem(self._who, f"reports {', '.join(flag_names(status.faults))}")
        elif status.mode is not MotorMode.RUN:
            checks.problem(self._who, f"is in mode {status.mode.name.lower()}, expected run")
        checks.refuse()
        return status

    def _bounded(self, position: float, velocity: float, stiffness: float, damping: float) -> float:
        """Give the position, moved towards the motor's where the MIT law would ask for more than the torque allowed."""
        status = self.status
        if self._torque is None:
            assert stiffness == damping == 0.0, "no torque was asked for"
            return position
        if status is None:
            return position
        command = MITCommand(*(np.array([value]) for value in (position, velocity, 0.0, stiffness, damping)))
        here, speed = np.array([status.position]), np.array([status.velocity])
        return float(bounded_position(command, here, speed, np.array([self._torque]), 2.0 * self._period)[0])

    def _stop(self) -> None:
        """Stop the motor, verify it, and give it its own CAN timeout and torque limit back."""
        if stop_motors(self._channels.requests, [self._motor]):
            raise RobotError(
                f"{self._who}: does not confirm that it stopped; without commands it stops by itself after "
                f"{1000.0 * CAN_TIMEOUT:g} ms; if it does not, switch its power off"
            )
        for name, value in self._old.items():
            if value is not None:
                write_value(self._channels, PARAMETERS[name], value, self._motor)

    def __exit__(self, *_: object) -> None:
        self._stop()
