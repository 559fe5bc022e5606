"""Motors on a bench, enabled for a moment: one that can be asked, or some that cannot."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Collection, Iterator, Sequence
from typing import Self

import numpy as np

from humanoid_sim.cli import complain
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import LinkTerms
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT, enable_motors, examine, make_ready, stop_motors
from humanoid_sim.hardware.robstride.link import RobstrideLink, Unreadable
from humanoid_sim.hardware.robstride.messages import MotorMode, OperationControl, Status, flag_names
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.sito.motors import SitoMotors
from humanoid_sim.hardware.tools.bench import FEEDBACK_PERIOD, Heard, heard_of, silence, write_value
from humanoid_sim.mit import MITCommand, bounded_position
from humanoid_sim.robots.motors import FAMILIES

_PERIOD = 0.01
"""s between commands to an enabled motor."""
_POLL = 0.001
"""s"""
_ANSWER_TIME = 0.3
"""s without feedback after which a motor that cannot be asked counts as silent."""
_PATIENCE = 0.75
"""s of commands without an answer after which a motor counts as silent."""
_DAMPING = 1.0
"""N·m·s/rad with which a guardian brakes a motor that nothing else stops."""
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
        accepted_firmware: Collection[str] = (),
    ) -> None:
        """Nothing is sent yet; the channels must know the motor's model.

        Args:
            torque: N·m that it may exert: its torque limit meanwhile, and the bound of what commands ask for. None: no
                torque will be asked for, see `identify`.
            accepted_firmware: versions that no document mentions and the operator accepts all the same.
        """
        self._channels = channels
        self._motor = motor
        self._torque = torque
        self._accepted_firmware = accepted_firmware
        self._motor_id = channels.motors.motor_id[motor]
        self._who = channels.motors.names[motor]
        self._old: dict[str, float | None] = {}
        self._sent, self._longest = 0.0, 0.0  # s: the last command, and the longest silence since a status in run mode
        self.status: Status | None = None

    def __enter__(self) -> Self:
        """Enable the motor, after every check that a session makes; warnings are printed before.

        Raises `RobotError` if another host drives it, it is another motor than expected or in another run mode, has no
        CAN timeout, or reports a fault.
        """
        channels, joints, checks = self._channels, [self._motor], CheckList(accepted=self._accepted_firmware)
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
        sample = channels.slots[self._motor].sample
        self.status = None if sample is None else sample.status
        return self

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Status:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; the status that follows.

        As the adapter does with a robot's, it moves a position that would ask for more torque than allowed. Raises
        `RobotError` if the motor is no longer enabled, reports a fault, or another host commands it too.
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
        for _ in range(round(_PATIENCE / _PERIOD)):
            now = time.monotonic()
            self._longest, self._sent = max(self._longest, now - self._sent), now
            found = self._channels.until_status({self._motor: [command]}, lambda _: True, (_PERIOD,))
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
        return float(bounded_position(command, here, speed, np.array([self._torque]), 2.0 * _PERIOD)[0])

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


@contextlib.contextmanager
def limp_motors(channels: RobstrideLink, joints: Sequence[int]) -> Iterator[SitoMotors]:
    """Enable these motors with zero gains and zero current, after all that a session checks; disabled at the end.

    Raises `RobotError` if another host drives them, one sends no feedback or reports torque, or does not confirm that
    it is disabled.

    Args:
        joints: whose motors, of one family.
    """
    motors = channels.motors.select(joints)
    damping = np.full(motors.count, _DAMPING)
    session = SitoMotors(channels.line, motors, LinkTerms(channels.host_id, 0.0, FEEDBACK_PERIOD, damping))
    channels.line.listeners.insert(0, session.receive)
    checks = CheckList()
    try:
        session.examine(checks)
        session.make_ready(checks)
        for warning in checks.warnings:
            complain(f"warning: {warning}")
        session.enable(checks)
        channels.line.check(checks)
        checks.refuse()
        yield session
    finally:
        left = session.stop(range(motors.count))
        session.close()
        channels.line.listeners.remove(session.receive)
        if left:
            names = ", ".join(motors.names[i] for i in left)
            raise RobotError(
                f"{names}: not confirmed to be disabled, and nothing stops such a motor by itself; switch its power off"
            )


class MovedMotor:
    """Commands for one motor that is enabled."""

    def __init__(self, channels: RobstrideLink, session: SitoMotors, torque: float) -> None:
        """Send nothing yet; `torque`, N·m, is what the commanded position may ask for."""
        self._channels = channels
        self._session = session
        self._torque = torque
        self._doubt = FAMILIES[session.motors.model[0].family].stiffness_doubt

    @property
    def position(self) -> float:
        """rad, motor frame, as last heard."""
        return float(self._session.readings().position[0])

    def command(self, position: float, velocity: float, stiffness: float, damping: float) -> Heard:
        """Send a command in the motor frame: rad, rad/s, N·m/rad, N·m·s/rad; where the motor is in its next feedback.

        It is sent in every period until then: the guardian must not take a silent motor for a tool that died.

        No torque limit is known: the commanded position, which stays within `torque / K_p` of the motor, is all that
        bounds it, with the largest K_p that the frame may mean. Raises `RobotError` if another host commands it too, or
        its channel is down.
        """
        reach = self._torque / (stiffness * self._doubt) if stiffness > 0.0 else math.inf
        here = self.position
        bounded = min(max(position, here - reach), here + reach)
        values = np.array([[bounded], [velocity], [0.0], [stiffness], [damping]])
        motors = self._session.motors
        before = np.nan_to_num(self._session.readings().time[0], nan=-math.inf)
        begin, sent = time.monotonic(), -math.inf
        while True:
            now = time.monotonic()
            if now - sent >= _PERIOD:
                self._session.command(values)
                sent = now
            if self._session.readings().time[0] > before:  # NaN: nothing was heard yet
                break
            if now - begin > _ANSWER_TIME:
                raise silence(self._channels, self._channels.motors.names.index(motors.names[0]), motors.names[0])
            time.sleep(_POLL)
        checks = CheckList()
        self._channels.line.check(checks)
        checks.refuse()
        return heard_of(self._session, 0)
