"""`hardware identify`: move one joint a little, limp first, and store the direction that a person confirms."""

from __future__ import annotations

import contextlib
import math
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import msgspec
import numpy as np

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import HumanoidSimError, InputError, RobotError, require_known
from humanoid_sim.hardware.calibration import CalibrationEntry, read_entries, save_calibration
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import CAN_TIMEOUT, LinkTerms, MotorLink
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools import bench
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
_PATIENCE = 0.75  # s without a status after which a motor counts as silent
_LIMIT, _POSITION = PARAMETERS["limit_torque"], PARAMETERS["mechPos"]


def identify(config: Identify) -> int:
    """Ask for confirmation, move, print, store, and return the exit status."""
    description, addresses = load_robot(config.robot), parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    require_known("joint", (config.joint,), wiring.names)
    joint = wiring.names.index(config.joint)
    motor_id, direction, limit = wiring.motor_id[joint], int(wiring.direction[joint]), wiring.effort_limit[joint]
    if not 0.02 <= config.angle <= 0.5:
        raise InputError(f"--angle: is {config.angle}, expected 0.02 to 0.5 rad")
    if not 0.0 < config.torque <= limit:
        raise InputError(f"--torque: is {config.torque}, expected more than 0 and at most {limit:g} N·m")
    for version in config.accept_firmware:
        parse_version(version)
    if joint in wiring.endless and not config.allow_no_timeout:
        raise InputError(
            f"{config.joint}: nothing stops its motor when this program dies: --allow-no-timeout accepts that"
        )
    entries = dict(read_entries(config.output, description))
    with real_time(), bench.open_bench(addresses, wiring) as link:
        if joint not in wiring.unasked:
            bench.ask_uid(link, joint)
        print(
            f"{config.joint}: motor {motor_id} on {link.sources[wiring.channel[joint]]} will move it by "
            f"{config.angle:+g} rad and back within {2 * _RAMP + _HOLD:g} s, with at most {config.torque:g} N·m"
        )
        bench.confirm("Is the arm supported and clear?", config.yes, "not moved")
        found = link.read(dict.fromkeys(range(wiring.count), _POSITION), (_ANSWER_TIME,))
        before = {i: position for i, position in found.items() if i != joint and position is not None}
        with _enabled(config, wiring, joint, link) as motor:
            moved, after = _move(config, wiring, joint, link, motor, before)
    print(
        f"motor {motor_id} moved by {moved:+.3f} rad; with direction {direction:+d} "
        f"that is {direction * moved:+.3f} rad of {config.joint}"
    )
    others = [i for i, position in after.items() if abs(position - before[i]) >= _MOVED * config.angle]
    for i in others:  # a limp one may swing along
        complain(
            f"warning: {wiring.names[i]} (motor {wiring.motor_id[i]}) moved too, by {after[i] - before[i]:+.3f} rad"
        )
    if direction * moved < _MOVED * config.angle:
        complain(f"warning: {config.joint} did not follow: raise --torque, or hold the arm's weight")
        return ExitStatus.FAILED
    is_stored = _store(config, entries, CalibrationEntry(motor_id, direction, None, True), wiring.names)
    return ExitStatus.of(is_stored and not others)


@contextlib.contextmanager
def _enabled(config: Identify, wiring: Wiring, joint: int, link: RobstrideLink) -> Iterator[MotorLink]:
    """Enable the joint's motor with the torque as its limit, and give it its own limit back at the end."""
    alone = replace(wiring.select([joint]), torque_limit=(config.torque,), current_limit=(0.0,))
    terms = LinkTerms(CAN_TIMEOUT, _PERIOD, np.array([_WATCHDOG_DAMPING]), {}, config.accept_firmware)
    old = None if joint in wiring.unasked else link.read({joint: _LIMIT}).get(joint)
    was_enabled = False
    try:
        with bench.enabled(link, alone, terms) as motor:
            was_enabled = True
            yield motor
    finally:
        if was_enabled and old is not None:
            with contextlib.suppress(HumanoidSimError):  # a silent motor, of which there is an error already
                bench.write_value(link, _LIMIT, old, joint)


def _move(
    config: Identify, wiring: Wiring, joint: int, link: RobstrideLink, motor: MotorLink, others: Iterable[int]
) -> tuple[float, dict[int, float]]:
    """Move there and back; returns rad by which the joint moved, and other motors' positions meanwhile, motor frame.

    A commanded position that would ask for more torque than allowed is moved towards the joint. Raises `RobotError` if
    the motor reports a fault, is silent or is moved by something else, or another host commands motors.
    """
    model, start = wiring.model[joint], float(motor.readings().position[0])
    step = float(wiring.direction[joint]) * config.angle
    stiffness = min(config.torque / config.angle, model.stiffness)
    damping = min(_DAMPING_TIME * stiffness, model.damping)
    doubt = wiring.stiffness_doubt[joint] * stiffness, wiring.damping_doubt[joint] * damping
    if abs(start + step) > wiring.position_range[joint]:
        raise RobotError(f"{config.joint}: is at {start:.2f} rad, too near the end of commands")
    limit, moved, there = np.array([config.torque]), 0.0, dict[int, float]()
    link.take_answers()  # late ones to earlier questions
    began = link.line.clock()
    for first, last, duration in ((0.0, 1.0, _RAMP), (1.0, 1.0, _HOLD), (1.0, 0.0, _RAMP)):
        begin, missing, elapsed = time.monotonic(), set(others) if first == last else set(), 0.0
        while elapsed < duration or (missing and elapsed < duration + _PATIENCE):
            elapsed = time.monotonic() - begin
            share = first + (last - first) * 0.5 * (1.0 - math.cos(math.pi * min(elapsed / duration, 1.0)))
            reading = motor.readings()
            command = MITCommand(*np.array([[start + share * step], [0.0], [0.0], [doubt[0]], [doubt[1]]]))
            bounded = bounded_position(command, reading.position, reading.velocity, limit, 2.0 * _PERIOD)
            motor.command(np.array([bounded, [0.0], [0.0], [stiffness], [damping]]))
            time.sleep(_PERIOD)
            _check(link, motor, config.joint, began)
            if link.line.clock() - reading.time[0] > _PATIENCE:
                raise bench.silence(link, wiring.channel[joint], f"motor {wiring.motor_id[joint]} does not answer")
            distance = float(motor.readings().position[0]) - start
            if abs(distance) > _FARTHEST * config.angle:
                raise RobotError(f"{config.joint}: has moved by {distance:+.2f} rad: let go")
            if first == last:
                moved = distance
                found = link.read(dict.fromkeys(missing, _POSITION), (0.0,), takes_late=True)
                there.update((i, position) for i, position in found.items() if position is not None)
                missing -= there.keys()
    return moved, there


def _check(link: RobstrideLink, motor: MotorLink, joint: str, since: float) -> None:
    checks = CheckList()
    link.line.check(checks)
    for finding in motor.findings(since):
        checks.problem(joint, finding.text)
    status = motor.status()
    if status is not None and status.level is SafetyLevel.FAULT:
        checks.problem(joint, status.message)
    checks.refuse()


def _store(
    config: Identify, entries: dict[str, CalibrationEntry], new: CalibrationEntry, names: tuple[str, ...]
) -> bool:
    """Ask which way it went, and store the answer; False if a person denies the direction."""
    name, old = config.joint, entries.get(config.joint)
    if not sys.stdin.isatty():
        print(f"{name}: its direction is not stored: no person confirms it where standard input is not a terminal")
        return True
    is_confirmed = bench.answers_yes(f"Did {name} go the way of a rising angle in the robot's model?")
    if old is not None and (old.id, old.direction) == (new.id, new.direction):
        new = msgspec.structs.replace(new, homing_offset=old.homing_offset)
    if not is_confirmed:
        complain(f"warning: {name}: not confirmed: if it went the other way, its direction in the robot file is wrong")
    if not is_confirmed and old is None:
        return False
    entries[name] = msgspec.structs.replace(
        new if is_confirmed or old is None else old, direction_confirmed=is_confirmed
    )
    save_calibration(config.output, entries, names)
    print(f"wrote {config.output}: direction of {name} {'confirmed' if is_confirmed else 'not confirmed'}")
    return is_confirmed
