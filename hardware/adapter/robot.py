"""A robot of motors on CAN channels, as the `Robot` protocol has it."""

from __future__ import annotations

import contextlib
import time as system_time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.adapter.control import (
    MotorControl,
    damp_until_rest,
    is_damped,
    is_limp,
    unconfirmed,
)
from humanoid_sim.hardware.adapter.guarding import MotorGuard
from humanoid_sim.hardware.adapter.joint_tracking import unheard
from humanoid_sim.hardware.adapter.robot_motors import RobotMotors, gain_warnings
from humanoid_sim.hardware.adapter.statistics import RobotStatistics, gather_statistics
from humanoid_sim.hardware.adapter.wiring import make_settings
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.address import open_bus as open_python_can
from humanoid_sim.hardware.bus.channel import OpenBus
from humanoid_sim.hardware.bus.open_channels import Locks
from humanoid_sim.hardware.checks import Check, CheckList
from humanoid_sim.hardware.imu import Imu, upright_at_rest
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT
from humanoid_sim.hardware.robstride.messages import DEFAULT_HOST_ID
from humanoid_sim.messages import OK, SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import ANCHOR_ORIENTATION, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE, flattened
from humanoid_sim.simulation.sensors import AnchorOrientation

_JUMPED = "its position jumped before: compare it with this list, and calibrate if it differs"


class HardwareRobot:
    """Real motors, or emulated ones that speak their protocol.

    Nothing is sent before `prepare` or `activate`. Both begin afresh each time: channels are opened again, every motor
    is identified, stopped, configured and verified; `activate` then enables them, without torque. In between, `read`
    and `write` never raise for anything that happens on a bus: it becomes a safety status, and a joint that is not
    heard keeps its last values and ages.
    """

    def __init__(
        self,
        description: RobotDescription,
        channels: Sequence[BusAddress | str],
        *,
        calibration: Mapping[str, float],
        control_period: float | None = None,
        clock: Callable[[], float] = system_time.monotonic,
        host_id: int = DEFAULT_HOST_ID,
        can_timeout: float = CAN_TIMEOUT,
        allow_no_timeout: bool = False,
        imu: Imu | None = None,
        anchor: AnchorOrientation | None = None,
        live: Callable[[], Mapping[str, FloatArray]] = dict,
        dry_run: bool = False,
        accepted_firmware: Collection[str] = (),
        open_bus: OpenBus = open_python_can,
    ) -> None:
        """Describe the robot; nothing is opened yet.

        Raises `InputError` if a channel, the calibration or a number does not fit.

        Args:
            channels: one that carries all motors, or one per bus of the robot in their order.
            calibration: homing offset of every joint, rad, motor frame.
            control_period: s between commands; None for the description's.
            clock: s, monotonic; the robot's own clock counts from now.
            can_timeout: s without a command after which the motors stop by themselves.
            allow_no_timeout: whether motors may be driven that nothing stops when this program dies.
            imu: where orientation comes from; without one the state is that of a base upright and at rest.
            live: other live inputs by name, as only mock motors know them.
            anchor: measures the live input `anchor_orientation` that a policy observes; None: it is not reported.
            dry_run: never enable: `activate` verifies everything and then refuses.
            accepted_firmware: versions that no document mentions and an operator accepts all the same.
        """
        self._description = description
        self._settings = make_settings(
            description,
            channels,
            calibration,
            control_period=control_period,
            host_id=host_id,
            can_timeout=can_timeout,
            allow_no_timeout=allow_no_timeout,
        )
        self._imu, self._anchor, self._live = imu, anchor, live
        self._dry_run = dry_run
        self._answered = set(accepted_firmware)
        self._open_bus = open_bus
        self._clock, self._origin = clock, clock()
        self._locks = Locks()
        self._motors: RobotMotors | None = None
        self._control: MotorControl | None = None
        self._past: RobotStatistics | None = None
        self._guard = MotorGuard(self._settings.wiring, self._settings.addresses, self._settings.damping)
        self._why_not = "not activated"
        self._may_run: frozenset[int] = frozenset()
        self._uids: Mapping[str, bytes] = {}
        self._slipped: frozenset[str] = frozenset()
        self._checks = CheckList(self._settings.name)
        self._is_closing = self._is_closed = False

    @property
    def joints(self) -> tuple[str, ...]:
        """See `Robot.joints`."""
        return self._settings.wiring.names

    @property
    def description(self) -> RobotDescription:
        """Return what this robot was built from."""
        return self._description

    @property
    def control_period(self) -> float:
        """Time between two commands, s."""
        return self._settings.control_period

    @property
    def time(self) -> float:
        """The robot's clock, s, from construction."""
        return self._clock() - self._origin

    @property
    def is_closed(self) -> bool:
        """Return whether `close` has done all it does: before that, there may be motors to protect."""
        return self._is_closed

    @property
    def is_enabled(self) -> bool:
        """Return whether the motors were enabled, and not disabled since by this program."""
        return self._control is not None and self._control.is_enabled

    @property
    def checks(self) -> tuple[Check, ...]:
        """Return what the latest `prepare` or `activate` found, for an operator to read."""
        return self._checks.all

    @property
    def statistics(self) -> RobotStatistics:
        """Return what happened on the buses since the first activation."""
        return gather_statistics(self._settings, self._motors, self._control, self.time, self._past)

    # --- activation

    def accept(self, about: Iterable[str]) -> None:
        """Accept what was a question, see `Check.about`; from the next activation on it is not asked."""
        self._answered.update(about)

    def prepare(self) -> None:
        """Verify and configure everything, and leave the motors stopped.

        Raises `RobotError` with the whole list of what is wrong. The robot can still be read, and reports that it is
        not enabled.
        """
        self._prepare()

    def activate(self) -> None:
        """Verify and configure everything afresh, then enable every motor, without torque.

        Raises `RobotError` with the whole list of what is wrong; no motor is enabled then.
        """
        motors, turns = self._prepare()
        if self._dry_run:
            raise RobotError(f"{self._settings.name}: not enabled: this is a dry run")
        try:
            self._checks.refuse_questions()
        except RobotError as error:
            self._explain(error, is_off=True)  # `_prepare` leaves them stopped, verified
            raise
        self._may_run = frozenset(range(self._settings.wiring.count))
        self._guard.standby()
        try:
            turns = motors.enable(turns, self._checks)
        except BaseException as error:
            self._give_up(error)
            raise
        self._control = MotorControl(self._settings, motors, turns, self._guard)
        self._control.enable(self.time)

    def _prepare(self) -> tuple[RobotMotors, FloatArray]:
        if self._is_closing:
            raise RobotError(f"{self._settings.name}: the robot is closed")
        if self._control is not None:
            self._slipped |= self._control.jumped
            if self._control.is_enabled:
                self._damp(self._control)  # or arms that still sink would fall while their motors are verified
        self._dismiss_guardian()
        self._retire()
        self._checks = CheckList(self._settings.name, self._answered)
        for joint, text in gain_warnings(self._description, self._settings.wiring):
            self._checks.warn(joint, text)
        for joint in sorted(self._slipped):  # whether lost turns or a slipped zero, nobody can tell from here
            self._checks.warn(joint, _JUMPED)
        try:
            motors = self._open()
            turns = motors.prepare(self._checks)
        except BaseException as error:
            self._give_up(error)
            raise
        self._may_run, self._uids = frozenset(), motors.uids
        self._control = MotorControl(self._settings, motors, turns, self._guard)
        return motors, turns

    def _retire(self) -> None:
        """Close the channels of an earlier activation, whose figures stay."""
        past = self.statistics
        if self._motors is not None:
            self._motors.close()
        self._motors, self._control, self._past = None, None, past
        self._why_not = "not enabled"

    def _open(self) -> RobotMotors:
        """Lock and open every channel afresh, and the IMU; whatever cannot be is reported together."""
        settings, checks = self._settings, self._checks
        self._locks.take(settings.addresses, checks)
        if self._imu is not None:
            self._imu.close()
            try:
                self._imu.open()
            except RobotError as error:
                checks.problem("imu", str(error))
        checks.refuse()
        open_bus = self._guard.start(self._locks, checks, self._open_bus)
        self._motors = RobotMotors(settings, self._uids, checks, clock=lambda: self.time, open_bus=open_bus)
        return self._motors

    def _give_up(self, error: BaseException) -> None:
        """After a refusal: stop the motors, unless another master drives them, whose arms would fall.

        Raises `RobotError` in place of one of these, where motors of an earlier activation do not confirm it.
        """
        motors, checks = self._motors, self._checks
        if motors is not None and (self._may_run or not motors.has_intruders):
            motors.line.forget_queues()
            self._may_run &= frozenset(motors.stop(range(self._settings.wiring.count)))
        self._guard.release(self._may_run)
        for joint in sorted(self._may_run):
            checks.problem(self._settings.wiring.names[joint], "does not confirm that it is disabled")
        refusal = RobotError(checks.refusal()) if self._may_run else error
        self._explain(refusal, is_off=motors is not None and not self._may_run and not motors.has_intruders)
        if isinstance(error, RobotError) and refusal is not error:
            raise refusal from error

    def _explain(self, refusal: BaseException, *, is_off: bool) -> None:
        """Note why nothing is enabled, and what to do; `is_off`: every motor has confirmed that it is disabled."""
        reason = flattened(str(refusal)) or type(refusal).__name__
        head = "the motors are off" if is_off else "no motor is driven"
        own = reason.removeprefix(f"{self._settings.name}: ")
        self._why_not = f"{head}: {own}; fix that, then {HOW_TO_REACTIVATE}"

    # --- the control loop

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the latest state, and a status per channel, of the IMU, and of this program's own commands if bad.

        Never raises, and waits for nothing.
        """
        now, control = self.time, self._control
        joints = unheard(self._settings.wiring.count) if control is None else control.read()
        age = np.maximum(now - joints.time, 0.0)
        imu = upright_at_rest(OK) if self._imu is None else self._imu.read(now)
        statuses = control.statuses(now, age) if control is not None and control.is_enabled else self._not_enabled()
        if self._imu is not None:
            statuses = (*statuses, imu.status)
        extern = {name: Extern(value, now) for name, value in self._live().items()}
        if self._anchor is not None:
            extern[ANCHOR_ORIENTATION] = Extern(self._anchor.read(joints.position, imu.quaternion), now)
        state = MITState(
            time=now,
            joint_position=joints.position,
            joint_velocity=joints.velocity,
            joint_effort=joints.effort,
            joint_age=age,
            imu_quaternion=imu.quaternion,
            imu_angular_velocity=imu.angular_velocity,
            imu_linear_acceleration=imu.linear_acceleration,
            extern=extern,
        )
        return state, statuses

    def _not_enabled(self) -> tuple[SafetyStatus, ...]:
        flags = SafetyFlag.BUS_OFF if self._motors is None else SafetyFlag.MOTOR_FAULT
        return tuple(SafetyStatus(SafetyLevel.FAULT, flags, source, self._why_not) for source in self._settings.sources)

    def write(self, command: MITCommand) -> None:
        """Hand a command, shape (n,), to every motor; returns at once. While the motors are not enabled, none is sent.

        A command that is not finite is replaced by damping, and reported. Raises `RobotError` if the command is for
        another number of joints, or the robot is closed.
        """
        name, n, shape = self._settings.name, self._settings.wiring.count, command.position.shape
        if shape != (n,) or self._is_closing:
            what = f"command has shape {shape}, expected ({n},)" if shape != (n,) else "the robot is closed"
            raise RobotError(f"{name}: {what}")
        if self._control is not None:
            self._control.write(command, self.time)

    # --- the end

    def close(self) -> None:
        """Damp the joints until they rest, disable every motor, verify that, and release everything. Twice is once.

        Raises `RobotError` if a motor did not confirm that it is disabled; everything else is done all the same.
        """
        if self._is_closing:
            return
        self._is_closing = True
        motors, control = self._motors, self._control
        with contextlib.ExitStack() as stack:  # left in reverse, whatever fails on the way
            stack.callback(self._ended)
            stack.callback(self._locks.release)
            if self._imu is not None:
                stack.callback(self._imu.close)
            if motors is not None:
                stack.callback(motors.close)
            stack.callback(lambda: self._guard.release(self._may_run))
            if motors is not None and (control is not None or self._may_run):
                try:
                    if control is not None:
                        self._damp(control)
                finally:
                    self._guard.take_back(motors.line.forget_queues)
                    self._may_run &= frozenset(motors.disable())
                    if control is not None:
                        control.disable()
        if self._may_run:
            text = unconfirmed(self._settings, motors, sorted(self._may_run))
            raise RobotError(f"{self._settings.name}: {text}")

    def _ended(self) -> None:
        self._is_closed = True
        self._why_not = "closed"

    def _damp(self, control: MotorControl) -> None:
        """Damp the joints, unless there was no torque, or they rest in DAMPING already."""
        if self._guard.drives:
            return
        last, stale = control.last_command, self._settings.rx_timeout
        if last is None or is_limp(last) or is_damped(last, self.read()[0], stale):
            return
        damp_until_rest(lambda: self.read()[0], lambda: control.damp(self.time), stale)

    def _dismiss_guardian(self) -> None:
        """Before everything begins afresh: disable the motors that a guardian watches, and end it."""
        if self._guard.joints and self._may_run and self._motors is not None:
            self._guard.take_back(self._motors.line.forget_queues)
            self._may_run = (self._may_run - self._guard.joints) | frozenset(self._motors.stop(self._guard.joints))
        self._guard.release(self._may_run)
