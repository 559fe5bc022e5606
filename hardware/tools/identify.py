"""`hardware identify`: move one joint a little, limp first, and store the direction that a person confirms."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import sys
import time
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError, require_known
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.calibration import CalibrationEntry, read_entries, save_calibration
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import LinkTerms, MotorLink
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import answer, ask_uid, confirm, enabled, open_bench, silence, write_value
from humanoid_sim.hardware.tools.options import Identify
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.mit import MITCommand, bounded_position
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import real_time

_PERIOD = 0.01  # s between commands
_RAMP = 1.0  # s to get there, and as long to get back
_HOLD = 0.5  # s to stay there, so that it is seen
_DAMPING_TIME = 0.05  # s, damping over stiffness: about critical for a forearm, and within every model's range
_WATCHDOG_DAMPING = 1.0  # N·m·s/rad with which a watchdog brakes a motor without a timeout
_MOVED = 0.3  # share of the angle from which on a joint counts as moved
_FARTHEST = 3.0  # share of the angle beyond which something else moves the joint, and it is let go
_ANSWER_TIME = 0.3  # s that motors have to report their positions, which takes them some milliseconds
_PATIENCE = 0.75  # s of commands without a status after which a motor counts as silent
_POLL = 0.001  # s


def identify(config: Identify) -> int:
    """Ask for confirmation, move, print, store, and return the exit status."""
    description = load_robot(config.robot)
    require_known("joint", (config.joint,), description.joint_names)
    if not 0.02 <= config.angle <= 0.5:
        raise InputError(f"--angle: is {config.angle}, expected 0.02 to 0.5 rad")
    for version in config.accept_firmware:
        parse_version(version)
    addresses = parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    joint = description.joint_names.index(config.joint)
    limit = float(wiring.effort_limit[joint])
    if not 0.0 < config.torque <= limit:
        raise InputError(f"--torque: is {config.torque}, expected more than 0 and at most {limit:g} N·m")
    if joint in wiring.endless and not config.allow_no_timeout:
        raise InputError(
            f"{config.joint}: its motor executes its last command for ever when this program dies; "
            "--allow-no-timeout accepts that"
        )
    entries = read_entries(config.output, description)
    with real_time(), open_bench(addresses, config.host_id, wiring) as link:
        if joint not in wiring.unasked:
            ask_uid(link, joint)
        print(
            f"{config.joint}: motor {wiring.motor_id[joint]} on {link.sources[wiring.channel[joint]]} will move it by "
            f"{config.angle:+g} rad and back within {2 * _RAMP + _HOLD:g} s, with at most {config.torque:g} N·m"
        )
        confirm("Is the arm supported and clear?", config.yes, "not moved")
        before = _positions(link)
        with _enabled(config, wiring, joint, link) as motor:
            start, after = _move(config, wiring, joint, motor, before)
        before.setdefault(joint, start)
    has_moved, is_alone = _report(config, wiring, joint, before, after)
    status = _store(config, wiring, joint, dict(entries)) if has_moved else ExitStatus.FAILED
    return status if is_alone else ExitStatus.FAILED


def _positions(link: RobstrideLink) -> dict[int, float]:
    """Return `mechPos` of every motor that reports it, rad, motor frame, by joint."""
    found = link.read(dict.fromkeys(range(link.motors.count), PARAMETERS["mechPos"]), (_ANSWER_TIME,))
    return {i: position for i, position in found.items() if position is not None}


class _Motor:
    """The joint's motor, enabled."""

    def __init__(self, config: Identify, wiring: Wiring, joint: int, bench: RobstrideLink, link: MotorLink) -> None:
        self.bench, self._link = bench, link
        self._joint, self._torque = joint, np.array([config.torque])
        self._doubt = float(wiring.stiffness_doubt[joint]), float(wiring.damping_doubt[joint])

    @property
    def position(self) -> float:
        """rad, motor frame, as reported last."""
        return float(self._link.readings().position[0])

    def command(self, position: float, stiffness: float, damping: float) -> float:
        """Send a command, and return the position of the next status: rad, motor frame.

        It moves a commanded position that would ask for more torque than allowed, and is sent in every period until the
        status comes, so that a lost frame makes no motor time out. Raises `RobotError` if the motor reports a fault or
        has stopped, or another host commands it.
        """
        reading = self._link.readings()
        known = np.isfinite(reading.time[0])
        wanted = [position, 0.0, 0.0, self._doubt[0] * stiffness, self._doubt[1] * damping]
        command = MITCommand(*(np.array([value]) for value in wanted))
        lead = 2.0 * _PERIOD
        bounded = (
            bounded_position(command, reading.position, reading.velocity, self._torque, lead) if known else position
        )
        values = np.array([[float(np.squeeze(bounded))], [0.0], [0.0], [stiffness], [damping]])
        clock = self.bench.line.clock
        begin, sent = clock(), -math.inf
        while not self._link.readings().time[0] > begin:  # NaN: nothing was received yet
            now = clock()
            if now - begin > _PATIENCE:
                motors = self.bench.motors
                raise silence(
                    self.bench, motors.channel[self._joint], f"motor {motors.motor_id[self._joint]} does not answer"
                )
            if now - sent >= _PERIOD:
                self._link.command(values)
                sent = now
            time.sleep(_POLL)
        self._check(begin)
        return self.position

    def _check(self, since: float) -> None:
        checks, name = CheckList(), self.bench.motors.names[self._joint]
        self.bench.line.check(checks)
        for finding in self._link.findings(since):
            checks.problem(name, finding.text)
        status = self._link.status()
        if status is not None and status.level is SafetyLevel.FAULT:
            checks.problem(name, status.message)
        checks.refuse()


@contextlib.contextmanager
def _enabled(config: Identify, wiring: Wiring, joint: int, bench: RobstrideLink) -> Iterator[_Motor]:
    """Enable the joint's motor with the torque as its limit, and give it its own limit back at the end."""
    alone = dataclasses.replace(wiring.select([joint]), torque_limit=(config.torque,), current_limit=(0.0,))
    terms = LinkTerms(config.host_id, CAN_TIMEOUT, _PERIOD, np.array([_WATCHDOG_DAMPING]), is_whole=False)
    limit = PARAMETERS["limit_torque"]
    old = None if joint in wiring.unasked else bench.read({joint: limit}).get(joint)
    was_enabled = False
    try:
        with enabled(bench, alone, terms, config.accept_firmware) as link:
            was_enabled = True
            yield _Motor(config, wiring, joint, bench, link)
    finally:
        if was_enabled and old is not None:
            with contextlib.suppress(HumanoidSimError):  # a silent motor, of which there is an error already
                write_value(bench, limit, old, joint)


def _move(
    config: Identify, wiring: Wiring, joint: int, motor: _Motor, others: Collection[int]
) -> tuple[float, dict[int, float]]:
    """Move there and back; returns where the motor began, and other motors' positions when it was there."""
    step = float(wiring.direction[joint]) * config.angle
    stiffness = min(config.torque / config.angle, wiring.model[joint].stiffness)
    damping = min(_DAMPING_TIME * stiffness, wiring.model[joint].damping)
    start = motor.command(motor.position, 0.0, 0.0)
    largest = float(wiring.position_range[joint])
    if abs(start + step) > largest:
        raise RobotError(f"{config.joint}: is at {start:.2f} rad, too near the end of commands, ±{largest:.2f}")
    there: dict[int, float] = {}

    def ramp(first: float, last: float, duration: float, missing: Collection[int] = ()) -> None:
        """Command for a time, s; meanwhile ask for these motors' positions."""
        begin = time.monotonic()
        while (elapsed := time.monotonic() - begin) < duration:
            share = first + (last - first) * 0.5 * (1.0 - math.cos(math.pi * elapsed / duration))
            position = motor.command(start + share * step, stiffness, damping)
            if abs(position - start) > _FARTHEST * config.angle:
                raise RobotError(f"{config.joint}: has moved by {position - start:+.2f} rad: let go")
            if missing:
                there.update(
                    motor.bench.poll_values(PARAMETERS["mechPos"], [i for i in missing if i not in there], 0.0)
                )
                if len(there) == len(missing):
                    break
            time.sleep(max(begin + elapsed + _PERIOD - time.monotonic(), 0.0))

    ramp(0.0, 1.0, _RAMP)
    ramp(1.0, 1.0, _HOLD)
    motor.bench.take_answers()  # late ones to earlier questions
    ramp(1.0, 1.0, _ANSWER_TIME, others)
    if joint in wiring.unasked:
        there[joint] = motor.position
    ramp(1.0, 0.0, _RAMP)
    motor.command(start, stiffness, damping)  # where the program was slow, the ramp's last command is short of it
    return start, there


def _report(
    config: Identify, wiring: Wiring, joint: int, before: Mapping[int, float], after: Mapping[int, float]
) -> tuple[bool, bool]:
    """Print what moved; returns whether the joint did, and whether no other did: a limp one may swing along."""
    moved = {i: after[i] - before[i] for i in after if i in before}
    own = moved.pop(joint, math.nan)
    others = {i: angle for i, angle in moved.items() if abs(angle) >= _MOVED * config.angle}
    direction = float(wiring.direction[joint])
    print(
        f"motor {wiring.motor_id[joint]} moved by {own:+.3f} rad; with direction {direction:+g} "
        f"that is {direction * own:+.3f} rad of {config.joint}"
    )
    for i, angle in others.items():
        complain(f"warning: {wiring.names[i]} (motor {wiring.motor_id[i]}) moved as well, by {angle:+.3f} rad")
    has_moved = direction * own >= _MOVED * config.angle
    if not has_moved:
        complain(f"warning: {config.joint} did not follow: raise --torque, or hold the arm's weight")
    return has_moved, not others


def _store(config: Identify, wiring: Wiring, joint: int, entries: dict[str, CalibrationEntry]) -> int:
    """Ask which way it went, and store a confirmed direction; returns the exit status."""
    name, motor_id, direction = config.joint, wiring.motor_id[joint], int(wiring.direction[joint])
    if not sys.stdin.isatty():
        print(f"{name}: its direction is not stored: no person confirms it where standard input is not a terminal")
        return 0
    is_confirmed = answer(f"Did {name} go the way of a rising angle in the robot's model?") == "yes"
    old = entries.get(name)
    is_same = old is not None and (old.id, old.direction) == (motor_id, direction)
    offset = old.homing_offset if old is not None and is_same else None
    if not is_confirmed:
        complain(f"warning: {name}: not confirmed: if it went the other way, its direction in the robot file is wrong")
        if old is None or not old.direction_confirmed:
            return ExitStatus.FAILED
        entries[name] = dataclasses.replace(old, direction_confirmed=False)
        if old.homing_offset is None:
            del entries[name]
    else:
        entries[name] = CalibrationEntry(motor_id, direction, offset, direction_confirmed=True)
    save_calibration(config.output, entries, wiring.names)
    print(f"wrote {config.output}: direction of {name} {'confirmed' if is_confirmed else 'not confirmed'}")
    return 0 if is_confirmed else ExitStatus.FAILED
