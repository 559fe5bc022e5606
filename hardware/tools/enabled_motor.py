"""One motor on a bench, enabled for a moment."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Self

import numpy as np

from humanoid_sim.cli import complain
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT, enable_motors, examine, make_ready, stop_motors
from humanoid_sim.hardware.robstride.messages import MotorMode, OperationControl, Status, flag_names
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.requests import RobstrideLink, Unreadable
from humanoid_sim.hardware.tools.bench import silence, write_value
from humanoid_sim.mit import MITCommand, bounded_position

_PERIOD = 0.01
"""s between commands to an enabled motor."""
_PATIENCE = 0.75
"""s of commands without an answer after which a motor counts as silent."""
_STOPPING = 0.8
"""Share of the CAN timeout from which on silence explains a motor that has stopped."""


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
        self._sent, self._longest = 0.0, 0.0  # s: the last command, and the longest silence since a status in run mode
        self.status: Status | None = None

    def __enter__(self) -> Self:
        """Enable the motor, after every check that a session makes; warnings are printed before.

        Raises:
            RobotError: another host drives it, it is another motor than expected or in another run mode, has no CAN
                timeout, or reports a fault.
        """
        channels, joints, checks = self._channels, [self._motor], CheckList(answered=self._accepted_firmware)
        examine(channels, joints, checks, takes_over=False, is_limp=self._torque is None)
        checks.refuse_questions()
        for name in ("canTimeout",) if self._torque is None else ("canTimeout", "limit_torque"):
            old = channels.read({self._motor: PARAMETERS[name]})[self._motor]
            self._old[name] = None if isinstance(old, Unreadable) else old
        try:
            make_ready(channels, joints, CAN_TIMEOUT, checks, takes_over=False, torque=self._torque)
            channels.line.check(checks)
            checks.refuse()
            for warning in checks.warnings:
                complain(f"warning: {warning}")
            enable_motors(channels, joints, CAN_TIMEOUT, checks)
            checks.refuse()
        except BaseException:
            self._stop()
            raise
        self._sent = time.monotonic()
        sample = channels.table.slots[self._motor].sample
        self.status = None if sample is None else sample.status
        return self

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Status:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; the status that follows.

        As the adapter does with a robot's, it moves a position that would ask for more torque than allowed.

        Raises:
            RobotError: the motor is no longer enabled, reports a fault, or another host commands it too.
        """
        command = OperationControl(
            self._motor_id, self._bounded(position, velocity, stiffness, damping), velocity, 0.0, stiffness, damping
        )
        self.status = status = self._exchange(command)
        checks = CheckList()
        self._channels.line.check(checks)
        if status.faults:
            checks.problem(self._who, f"reports {', '.join(flag_names(status.faults))}")
        elif status.mode is not MotorMode.RUN:
            why = ""
            if self._longest >= _STOPPING * CAN_TIMEOUT:
                why = f": the motor's CAN timeout stopped it, as no command left for {1000.0 * self._longest:.0f} ms"
            checks.problem(self._who, f"is in mode {status.mode.name.lower()}, expected run{why}")
        checks.refuse()
        self._longest = 0.0
        return status

    def _exchange(self, command: OperationControl) -> Status:
        """Send a command in every period until a status follows: a lost answer must not make the motor time out."""
        for _ in range(round(_PATIENCE / self._period)):
            now = time.monotonic()
            self._longest, self._sent = max(self._longest, now - self._sent), now
            found = self._channels.until_status({self._motor: [command]}, lambda _: True, (self._period,))
            if found:
                return found[self._motor]
        raise silence(self._channels, self._motor)

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
        if stop_motors(self._channels, [self._motor]):
            raise RobotError(
                f"{self._who}: does not confirm that it stopped; without commands it stops by itself after "
                f"{1000.0 * CAN_TIMEOUT:g} ms; if it does not, switch its power off"
            )
        for name, value in self._old.items():
            if value is not None:
                write_value(self._channels, PARAMETERS[name], value, self._motor)

    def __exit__(self, *_: object) -> None:
        self._stop()
