"""A robot of motors on CAN channels, as the `Robot` protocol has it."""

from __future__ import annotations

import contextlib
import math
import time as system_time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.can_bus import NEVER, STRANGERS, BusAddress, OpenBus, OpenChannels, parse_address
from humanoid_sim.hardware.can_bus import open_bus as open_python_can
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.imu import UPRIGHT_AT_REST, Imu
from humanoid_sim.hardware.joints import (
    JointReadings,
    JointTracker,
    check_positions,
    find_turns,
    make_wiring,
    motor_values,
)
from humanoid_sim.hardware.motor_link import CAN_TIMEOUT, LinkTerms, Motor, MotorLink, Readings
from humanoid_sim.hardware.robstride.motors import RobstrideMotors
from humanoid_sim.hardware.robstride.parameters import CAN_TIMEOUT_TICK, LONGEST_CAN_TIMEOUT
from humanoid_sim.hardware.safety import channel_status, joint_findings
from humanoid_sim.hardware.sito.motors import SitoMotors
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import ANCHOR_ORIENTATION, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.session.requests import HOW_TO_REACTIVATE, flattened
from humanoid_sim.session.rest import RestDetector
from humanoid_sim.simulation.kinematics import AnchorOrientation

LINKS: Mapping[str, Callable[[OpenChannels, Sequence[Motor], LinkTerms], MotorLink]] = {
    "sito": SitoMotors,
    "robstride": RobstrideMotors,
}
"""By family, in the order in which a frame is offered to them: Robstride's identifiers have no mark."""

_LEAD = 2.0  # control periods: the age of a state and the time that a command is held, see `bounded_position`
_LONGEST = 3.0  # s that closing may damp, as at the end of a session
_PERIOD = 0.01  # s between damping commands then
_BAD_COMMAND = SafetyStatus(
    SafetyLevel.CRITICAL, SafetyFlag.NONE, "host", "a command was not finite and was replaced by damping"
)


class HardwareRobot:
    """Real motors, or emulated ones that speak their protocol.

    Nothing is sent before `prepare` or `activate`. Both begin afresh each time: channels are opened again, every motor
    is identified, stopped, configured and verified; `activate` then enables them, without torque. In between, `read`
    and `write` never raise for anything that happens on a bus: it becomes a safety status, and a joint that is not
    received keeps its last values and ages.
    """

    def __init__(
        self,
        description: RobotDescription,
        channels: Sequence[BusAddress | str],  # one that carries all motors, or one per bus of the robot in their order
        *,
        calibration: Mapping[str, float],  # homing offset of every joint, rad, motor frame
        unconfirmed: Sequence[str] = (),  # joints whose direction no person has confirmed
        control_period: float | None = None,  # s between commands; None for the description's
        clock: Callable[[], float] = system_time.monotonic,  # s; the robot's own clock counts from now
        can_timeout: float = CAN_TIMEOUT,  # s without a command after which the motors stop by themselves
        allow_no_timeout: bool = False,  # motors may be driven that nothing stops when this program dies
        imu: Imu | None = None,  # without one the state is that of a base upright and at rest
        anchor: AnchorOrientation | None = None,  # measures the live input `anchor_orientation`
        live: Callable[[], Mapping[str, FloatArray]] = dict,  # other live inputs by name, as only mock motors know them
        accepted_firmware: Collection[str] = (),  # versions that no document mentions and an operator accepts
        open_bus: OpenBus = open_python_can,
    ) -> None:
        """Describe the robot; nothing is opened yet."""
        self.description = description
        self.control_period = 1.0 / description.hardware.control_frequency if control_period is None else control_period
        self._name = description.name
        self._addresses = tuple(parse_address(each) if isinstance(each, str) else each for each in channels)
        self._wiring = wiring = make_wiring(description, len(self._addresses), calibration)
        longest = CAN_TIMEOUT_TICK * LONGEST_CAN_TIMEOUT
        if not self.control_period < can_timeout <= longest:
            accepted = f"more than the control period of {self.control_period:g} s, and at most {longest:g} s"
            raise InputError(f"CAN timeout: is {can_timeout:g} s, expected {accepted}")
        if wiring.endless and not allow_no_timeout:
            endless = ", ".join(wiring.names[i] for i in wiring.endless)
            text = f"motors that execute their last command for ever when this program dies: {endless}"
            raise InputError(f"{self._name}: {text}; --allow-no-timeout accepts that")
        self._sources = []
        for index, address in enumerate(self._addresses):
            families = dict.fromkeys(motor.model.family for motor in wiring.motors if motor.channel == index)
            self._sources.append(f"humanoid_devices_{'_'.join(families)}/{address}")
        self._rx_timeout = description.hardware.rx_timeout_ms / 1000.0
        self._undirected = ", ".join(unconfirmed)
        self._imu, self._anchor, self._live = imu, anchor, live
        self._terms = LinkTerms(can_timeout, self.control_period, accepted_firmware=accepted_firmware)
        self._open_bus = open_bus
        self._clock, self._origin = clock, clock()
        zeros = np.zeros(len(wiring.motors))
        self._damped = MITCommand(zeros, zeros, zeros, zeros, description.mode_damping)

        self._line: OpenChannels | None = None
        self._links: list[tuple[MotorLink, list[int]]] = []  # with the joints of their motors
        self._track()
        self._enabled_since: float | None = None  # s, robot's clock; None: the motors are not enabled
        self._why_not = "not activated"
        self._may_run: frozenset[int] = frozenset()  # joints whose motors may be enabled, as far as this program knows
        self._last_command: MITCommand | None = None
        self._bad_command = -math.inf  # s, robot's clock, of the latest command that was not finite
        self._commands = 0
        self._slipped: set[str] = set()
        self.checks = CheckList(self._name)  # findings of the latest `prepare` or `activate`
        self._is_closing = False
        self.is_closed = False  # `close` has done all it does: before that, there may be motors to protect

    @property
    def joints(self) -> tuple[str, ...]:
        return self._wiring.names

    @property
    def time(self) -> float:
        """The robot's clock, s, from construction."""
        return self._clock() - self._origin

    # --- activation

    def prepare(self) -> None:
        """Do all that `activate` does before it enables; what an operator has to accept is in `checks`."""
        self._bring_up(enables=False)

    def activate(self) -> None:
        """Verify and configure everything afresh, then enable every motor, without torque.

        Raises `RobotError` with the whole list of what is wrong; no motor is enabled then.
        """
        self._bring_up(enables=True)

    def _bring_up(self, *, enables: bool) -> None:
        if self._is_closing:
            raise RobotError(f"{self._name}: the robot is closed")
        self._slipped |= {self.joints[i] for i in np.flatnonzero(self._tracker.jumped)}
        self._damp()  # or arms that still sink would fall while their motors are verified
        self._retire()
        self.checks = CheckList(self._name)
        try:
            self._verify(self.checks)
            if enables:
                self._enable(self.checks)
        except BaseException as error:
            self._give_up(error)
            raise
        if enables:
            self._enabled_since, self._commands = self.time, 0

    def _verify(self, checks: CheckList) -> None:
        """Open everything, identify every motor, and only then stop and configure them."""
        if self._undirected:
            checks.warn(self._name, f"no person has confirmed the direction (hardware identify) of {self._undirected}")
        for joint in sorted(self._slipped):  # whether lost turns or a slipped zero, nobody can tell from here
            checks.warn(joint, "its position jumped before: compare it with this list, and calibrate if it differs")
        line = self._open(checks)
        for link, _ in self._links:
            link.examine(checks)
        checks.refuse(questions=False)
        for link, _ in self._links:
            link.make_ready(checks)
        known = set(range(len(self.joints))) - set(self._wiring.unasked)
        check_positions(self._wiring, known, self._readings().position, checks)
        line.check(checks)
        checks.refuse(questions=False)
        self._may_run = frozenset()
        for source, channel in zip(line.sources, line.channels, strict=True):
            for kind, count in channel.strangers.items():
                checks.warn(source, f"{count} × {kind}: {STRANGERS}")
        self._track()

    def _open(self, checks: CheckList) -> OpenChannels:
        """Open every channel afresh, and the IMU; whatever cannot be is reported together."""
        if self._imu is not None:
            self._imu.close()
            with checks.collecting("imu"):
                self._imu.open()
        self._line = line = OpenChannels(self._addresses, checks, clock=lambda: self.time, open_bus=self._open_bus)
        motors = self._wiring.motors
        for family, make_link in LINKS.items():
            joints = [i for i, motor in enumerate(motors) if motor.model.family == family]
            # A family without motors here has a link as well, which takes that family's frames off the others.
            link = make_link(line, [motors[i] for i in joints], self._terms)
            line.listeners.append(link.receive)
            if joints:
                self._links.append((link, joints))
        return line

    def _enable(self, checks: CheckList) -> None:
        """Enable every motor, family by family; those that cannot be asked now report where they are."""
        assert self._line is not None
        checks.refuse()
        self._may_run = frozenset(range(len(self.joints)))
        for link, _ in self._links:
            link.enable(checks)
            self._line.check(checks)
            checks.refuse()
        check_positions(self._wiring, self._wiring.unasked, self._readings().position, checks)
        checks.refuse()
        self._track()

    def _track(self) -> None:
        """Forget where the joints were; which turn each is on follows from where its motor says that it is."""
        self._tracker = JointTracker(self._wiring, find_turns(self._wiring, self._readings().position))
        self._read_joints()

    def _retire(self) -> None:
        """Stop what may run, and close the channels of an earlier activation."""
        if self._may_run:
            self._stop(self._may_run)
        for link, _ in self._links:
            link.close()
        if self._line is not None:
            self._line.close()
        self._line, self._links = None, []
        self._enabled_since = self._last_command = None
        self._track()
        self._why_not = "not enabled"

    def _give_up(self, error: BaseException) -> None:
        """After a refusal, stop the motors, unless another master drives them, whose arms would fall."""
        line = self._line
        is_ours = line is not None and (self._may_run or all(each.intruder is NEVER for each in line.channels))
        if is_ours:
            self._stop(range(len(self.joints)))
        for link, _ in self._links:
            link.close()
        reason = flattened(str(error)).removeprefix(f"{self._name}: ") or type(error).__name__
        head = "the motors are off" if is_ours else "no motor is driven"
        if self._may_run:
            head = f"not confirmed to be disabled: {', '.join(self.joints[i] for i in sorted(self._may_run))}"
        self._why_not = f"{head}: {reason}; fix that, then {HOW_TO_REACTIVATE}"

    # --- the control loop

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the latest state, and a status per channel, of the IMU, and of this program's own commands if bad.

        Never raises, and waits for nothing.
        """
        now = self.time
        joints = self._read_joints()
        age = np.maximum(now - joints.time, 0.0)
        statuses = self._statuses(now, age)
        imu = UPRIGHT_AT_REST
        if self._imu is not None:
            imu = self._imu.read(now)
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

    def _readings(self) -> Readings:
        """Return the latest state of every motor, shape (n,)."""
        arrays = np.full((len(Readings._fields), len(self.joints)), np.nan)
        for link, joints in self._links:
            arrays[:, joints] = link.readings()
        return Readings(*arrays)

    def _read_joints(self) -> JointReadings:
        self._joints = self._tracker.update(self._readings())
        return self._joints

    def _statuses(self, now: float, age: FloatArray) -> tuple[SafetyStatus, ...]:
        line = self._line
        if line is None or self._enabled_since is None:
            flag = SafetyFlag.BUS_OFF if line is None else SafetyFlag.MOTOR_FAULT
            return tuple(SafetyStatus(SafetyLevel.FAULT, flag, source, self._why_not) for source in self._sources)
        watchdogs = tuple(status for link, _ in self._links if (status := link.status()) is not None)
        if any(status.level is SafetyLevel.FAULT for status in watchdogs):
            return watchdogs  # whatever the motors do is its doing
        since = max(now - self._rx_timeout, self._enabled_since)
        findings = joint_findings(self._wiring.motors, age, self._rx_timeout, self._tracker)
        for link, _ in self._links:
            findings += link.findings(since)
        statuses = [
            channel_status(source, channel, [one for one in findings if one.motor.channel == index], since)
            for index, (source, channel) in enumerate(zip(self._sources, line.channels, strict=True))
        ]
        bad = (_BAD_COMMAND,) if now - self._bad_command <= self._rx_timeout else ()
        return (*statuses, *bad, *watchdogs)

    def write(self, command: MITCommand) -> None:
        """Hand a command, shape (n,), to every motor; returns at once. While the motors are not enabled, none is sent.

        A command that is not finite is replaced by damping, and reported. Raises `RobotError` if the command is for
        another number of joints, or the robot is closed.
        """
        n, shape = len(self.joints), command.position.shape
        if shape != (n,) or self._is_closing:
            what = f"command has shape {shape}, expected ({n},)" if shape != (n,) else "the robot is closed"
            raise RobotError(f"{self._name}: {what}")
        self._write(command)

    def _write(self, command: MITCommand) -> None:
        if self._enabled_since is None:
            return
        if not command.is_finite():
            self._bad_command = self.time
            command = self._damped
        self._last_command = command
        values = motor_values(self._wiring, command, self._joints, self._tracker, _LEAD * self.control_period)
        self._commands += 1
        for link, joints in self._links:
            link.command(values[:, joints])

    # --- the end

    def close(self) -> None:
        """Damp the joints until they rest, disable every motor, verify that, and release everything. Twice is once.

        Raises `RobotError` if a motor did not confirm that it is disabled; everything else is done all the same.
        """
        if self._is_closing:
            return
        self._is_closing = True
        left: dict[int, str] = {}
        with contextlib.ExitStack() as stack:  # left in reverse, whatever fails on the way
            stack.callback(self._ended)
            for each in (self._imu, self._line, *(link for link, _ in self._links)):
                if each is not None:
                    stack.callback(each.close)
            if self._may_run:
                try:
                    self._damp()
                finally:
                    self._enabled_since = None
                    left = self._stop(self._stop(range(len(self.joints))))  # once more, for a lost frame
        if self._may_run:
            names = ", ".join(f"{self.joints[i]} ({left.get(i, 'no status')})" for i in sorted(self._may_run))
            raise RobotError(f"{self._name}: not confirmed to be disabled: {names}; switch the power off")

    def _ended(self) -> None:
        self.is_closed = True
        self._why_not = "closed"

    def _stop(self, joints: Collection[int]) -> dict[int, str]:
        """Disable motors; those that did not confirm it, with the mode that they last reported."""
        left: dict[int, str] = {}
        if self._line is None:
            return left
        self._line.forget_queues()
        for link, own in self._links:
            motors = [motor for motor, joint in enumerate(own) if joint in joints]
            if motors:
                left.update((own[motor], text) for motor, text in link.stop(motors).items())
        self._may_run &= left.keys()
        return left

    def _damp(self) -> None:
        """Damp the joints until they are known to rest, for 3 s at most; unless there was no torque."""
        last = self._last_command
        if last is None or not (last.stiffness.any() or last.damping.any() or last.effort.any()):
            return
        rest = RestDetector(_PERIOD)
        deadline = system_time.monotonic() + _LONGEST
        while system_time.monotonic() < deadline:
            self._write(self._damped)
            if rest.update(self.read()[0]):
                return
            system_time.sleep(_PERIOD)

    def figures(self) -> dict[str, Any]:
        """Return figures of the buses since the latest activation, as JSON values, and in words as `lines`."""
        channels = [
            {"source": str(each.address), "sent": each.sent, "received": each.received, "errors": each.errors}
            for each in (() if self._line is None else self._line.channels)
        ]
        text = "{source}: {sent} frames sent, {received} received, {errors} errors"
        lines = [f"{self._commands} commands to each of {len(self.joints)} motors"]
        lines += [text.format(**each) for each in channels]
        temperatures = zip(self.joints, self._readings().temperature.tolist(), strict=True)
        return {
            "channels": channels,
            "commands": self._commands,
            "temperature": {joint: value for joint, value in temperatures if math.isfinite(value)},
            "lines": lines,
        }
