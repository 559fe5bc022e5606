"""`hardware identify`: move one joint a little, limp first, and store the direction that a person confirms."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping

import numpy as np

from humanoid_sim.cli import ExitStatus, complain
from humanoid_sim.errors import InputError, RobotError, require_known
from humanoid_sim.files import output_file
from humanoid_sim.hardware.calibration import CalibrationEntry, read_entries, save_calibration
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import CAN_TIMEOUT, LinkTerms, MotorLink
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools import bench
from humanoid_sim.hardware.tools.options import Identify
from humanoid_sim.mit import MITCommand, bounded_position
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import MotorDescription
from humanoid_sim.session.realtime import real_time

_PERIOD = 0.01  # s between commands
_RAMP = 1.0  # s to get there, and as long to get back
_HOLD = 0.5  # s to stay there, so that it is seen
_DAMPING_TIME = 0.05  # s, damping over stiffness: about critical for a forearm, and within every model's range
_WATCHDOG_DAMPING = 1.0  # N·m·s/rad with which a watchdog brakes a motor without a timeout
_MOVED = 0.3  # share of the angle from which on a joint counts as moved
_FARTHEST = 3.0  # share of the angle beyond which something else moves the joint, and it is let go
_PATIENCE = 0.75  # s without a status after which a motor counts as silent
_POSITION = PARAMETERS["mechPos"]


def identify(config: Identify) -> int:
    """Ask for confirmation, move, print, store, and return the exit status."""
    description, addresses = load_robot(config.robot), parse_addresses(config.channels)
    wiring = make_wiring(description, len(addresses))
    require_known("joint", (config.joint,), wiring.names)
    joint = wiring.names.index(config.joint)
    wired, limit = description.joints[joint].motor, wiring.effort_limit[joint]
    assert wired is not None
    if not 0.02 <= config.angle <= 0.5:
        raise InputError(f"--angle: is {config.angle}, expected 0.02 to 0.5 rad")
    if not 0.0 < config.torque <= limit:
        raise InputError(f"--torque: is {config.torque}, expected more than 0 and at most {limit:g} N·m")
    if joint in wiring.endless and not config.allow_no_timeout:
        text = "nothing stops its motor when this program dies: --allow-no-timeout accepts that"
        raise InputError(f"{config.joint}: {text}")
    entries = dict(read_entries(config.output, description))
    output_file(config.output, "--output")
    alone = wiring.motors[joint]._replace(torque_limit=config.torque, current_limit=0.0, damping=_WATCHDOG_DAMPING)
    terms = LinkTerms(CAN_TIMEOUT, _PERIOD, accepted_firmware=config.accept_firmware)
    with real_time(), bench.open_bench(addresses, wiring.motors) as link:
        if joint not in wiring.unasked:
            bench.answer_of(link, joint, link.read_uids([joint]))
        print(
            f"{config.joint}: motor {wired.can_id} on {addresses[alone.channel]} will move it by "
            f"{config.angle:+g} rad and back within {2 * _RAMP + _HOLD:g} s, with at most {config.torque:g} N·m"
        )
        bench.confirm("Is the arm supported and clear?", config.yes, "not moved")
        found = link.read(_POSITION, range(len(wiring.motors)))
        before = {i: position for i, position in found.items() if i != joint and math.isfinite(position)}
        with bench.limp_motors(link, [alone], terms) as motor:
            moved, shifts = _move(config, wiring, joint, link, motor, before)
    print(
        f"motor {wired.can_id} moved by {moved:+.3f} rad; with direction {wired.direction:+d} "
        f"that is {wired.direction * moved:+.3f} rad of {config.joint}"
    )
    others = [i for i, shift in shifts.items() if abs(shift) >= _MOVED * config.angle]
    for i in others:  # a limp one may swing along
        complain(f"warning: {wiring.names[i]} (motor {wiring.motors[i].motor_id}) moved too, by {shifts[i]:+.3f} rad")
    if wired.direction * moved < _MOVED * config.angle:
        complain(f"warning: {config.joint} did not follow: raise --torque, or hold the arm's weight")
        return ExitStatus.FAILED
    is_stored = _store(config, entries, wired, wiring.names)
    return ExitStatus.of(is_stored and not others)


def _move(
    config: Identify, wiring: Wiring, joint: int, link: RobstrideLink, motor: MotorLink, before: Mapping[int, float]
) -> tuple[float, dict[int, float]]:
    """Move there and back; returns rad by which the joint moved, and other motors meanwhile, motor frame.

    A commanded position that would ask for more torque than allowed is moved towards the joint. Raises `RobotError` if
    the motor reports a fault, is silent or is moved by something else, or another host commands motors.
    """
    wired, model, start = wiring.motors[joint], wiring.motors[joint].model, float(motor.readings().position[0])
    step = float(wiring.direction[joint]) * config.angle
    stiffness = min(config.torque / config.angle, model.stiffness)
    damping = min(_DAMPING_TIME * stiffness, model.damping)
    strongest = [wiring.stiffness_doubt[joint] * stiffness], [wiring.damping_doubt[joint] * damping]
    limit = np.array([config.torque])
    began = link.line.clock()

    def drive(share: float) -> float:
        """Command a share of the way for one period; returns rad by which the joint has moved."""
        reading = motor.readings()
        command = MITCommand(*np.array([[start + share * step], [0.0], [0.0], *strongest]))
        bounded = bounded_position(command, reading.position, reading.velocity, limit, 2.0 * _PERIOD)
        motor.command(np.array([bounded, [0.0], [0.0], [stiffness], [damping]]))
        time.sleep(_PERIOD)
        bench.check_channels(link)
        for finding in motor.findings(began):
            raise RobotError(f"{config.joint}: {finding.text}")
        if link.line.clock() - reading.time[0] > _PATIENCE:
            raise bench.silence(link, wired.channel, f"motor {wired.motor_id} does not answer")
        distance = float(motor.readings().position[0]) - start
        if abs(distance) > _FARTHEST * config.angle:
            raise RobotError(f"{config.joint}: has moved by {distance:+.2f} rad: let go")
        return distance

    for share in _shares():
        drive(share)
    moved, shifts, begin = 0.0, dict[int, float](), time.monotonic()
    link.take_values(_POSITION)  # late answers to earlier questions
    missing = set(before)
    while time.monotonic() - begin < (_HOLD + _PATIENCE if missing else _HOLD):
        moved = drive(1.0)
        found = link.read(_POSITION, missing, (0.0,), takes_late=True)
        shifts |= {i: position - before[i] for i, position in found.items() if math.isfinite(position)}
        missing -= shifts.keys()
    for share in _shares():
        drive(1.0 - share)
    return moved, shifts


def _shares() -> Iterator[float]:
    """Give shares of the way, from 0 to 1 within the ramp's time, smooth at both ends."""
    begin, elapsed = time.monotonic(), 0.0
    while elapsed < _RAMP:
        elapsed = time.monotonic() - begin
        yield 0.5 * (1.0 - math.cos(math.pi * min(elapsed / _RAMP, 1.0)))


def _store(
    config: Identify, entries: dict[str, CalibrationEntry], motor: MotorDescription, names: tuple[str, ...]
) -> bool:
    """Ask which way it went, and store the answer; False if a person denies the direction."""
    name = config.joint
    if not sys.stdin.isatty():
        print(f"{name}: its direction is not stored: no person confirms it where standard input is not a terminal")
        return True
    is_confirmed = bench.answers_yes(f"Did {name} go the way of a rising angle in the robot's model?")
    old = entries.get(name, CalibrationEntry(motor.can_id, motor.direction))
    offset = old.homing_offset if (old.id, old.direction) == (motor.can_id, motor.direction) else None
    if is_confirmed or offset is not None:
        entries[name] = CalibrationEntry(motor.can_id, motor.direction, offset, is_confirmed)
        save_calibration(config.output, entries, names)
        print(f"wrote {config.output}: direction of {name} {'confirmed' if is_confirmed else 'not confirmed'}")
    if not is_confirmed:
        complain(f"warning: {name}: not confirmed: if it went the other way, its direction in the robot file is wrong")
    return is_confirmed
