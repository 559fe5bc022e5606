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
from humanoid_sim.hardware.bus.address import parse_addresses
from humanoid_sim.hardware.calibration import CalibrationEntry, read_entries, save_calibration
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.joints import Wiring, make_wiring
from humanoid_sim.hardware.motor_link import LinkTerms, MotorLink
from humanoid_sim.hardware.robstride.enabling import CAN_TIMEOUT
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.hardware.robstride.link import RobstrideLink
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.tools.bench import (
    answers_yes,
    ask_uid,
    confirm,
    enabled,
    open_bench,
    silence,
    write_value,
)
from humanoid_sim.hardware.tools.options import Identify
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.mit import FloatArray, MITCommand, bounded_position
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
    limit = float(wiring.effort_limit[joint])
    if not 0.02 <= config.angle <= 0.5:
        raise InputError(f"--angle: is {config.angle}, expected 0.02 to 0.5 rad")
    if not 0.0 < config.torque <= limit:
        raise InputError(f"--torque: is {config.torque}, expected more than 0 and at most {limit:g} N·m")
    for version in config.accept_firmware:
        parse_version(version)
    if joint in wiring.endless and not config.allow_no_timeout:
        raise InputError(
            f"{config.joint}: its motor executes its last command for ever when this program dies; "
            "--allow-no-timeout accepts that"
        )
    entries = dict(read_entries(config.output, description))
    with real_time(), open_bench(addresses, wiring) as bench:
        if joint not in wiring.unasked:
            ask_uid(bench, joint)
        print(
            f"{config.joint}: motor {wiring.motor_id[joint]} on {bench.sources[wiring.channel[joint]]} will move it by "
            f"{config.angle:+g} rad and back within {2 * _RAMP + _HOLD:g} s, with at most {config.torque:g} N·m"
        )
        confirm("Is the arm supported and clear?", config.yes, "not moved")
        found = bench.read(dict.fromkeys(range(wiring.count), _POSITION), (_ANSWER_TIME,))
        before = {i: position for i, position in found.items() if i != joint and position is not None}
        with _enabled(config, wiring, joint, bench) as link:
            moved, after = _Move(config, wiring, joint, bench, link).run(before)
    direction = int(wiring.direction[joint])
    print(
        f"motor {wiring.motor_id[joint]} moved by {moved:+.3f} rad; with direction {direction:+d} "
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
    is_stored = _store(config, entries, CalibrationEntry(wiring.motor_id[joint], direction, None, True), wiring.names)
    return ExitStatus.of(is_stored and not others)


@contextlib.contextmanager
def _enabled(config: Identify, wiring: Wiring, joint: int, bench: RobstrideLink) -> Iterator[MotorLink]:
    """Enable the joint's motor with the torque as its limit, and give it its own limit back at the end."""
    alone = replace(wiring.select([joint]), torque_limit=(config.torque,), current_limit=(0.0,))
    terms = LinkTerms(CAN_TIMEOUT, _PERIOD, np.array([_WATCHDOG_DAMPING]))
    old = None if joint in wiring.unasked else bench.read({joint: _LIMIT}).get(joint)
    was_enabled = False
    try:
        with enabled(bench, alone, terms, config.accept_firmware) as link:
            was_enabled = True
            yield link
    finally:
        if was_enabled and old is not None:
            with contextlib.suppress(HumanoidSimError):  # a silent motor, of which there is an error already
                write_value(bench, _LIMIT, old, joint)


class _Move:
    """One joint's way there and back; positions in the motor frame."""

    def __init__(self, config: Identify, wiring: Wiring, joint: int, bench: RobstrideLink, link: MotorLink) -> None:
        self._config, self._bench, self._link = config, bench, link
        model, self._place = wiring.model[joint], (wiring.channel[joint], wiring.motor_id[joint])
        self._begin, self._start = bench.line.clock(), self.position
        self._step = float(wiring.direction[joint]) * config.angle
        self._stiffness = min(config.torque / config.angle, model.stiffness)
        self._damping = min(_DAMPING_TIME * self._stiffness, model.damping)
        self._doubt = float(wiring.stiffness_doubt[joint]), float(wiring.damping_doubt[joint])
        largest = float(wiring.position_range[joint])
        if abs(self._start + self._step) > largest:
            raise RobotError(
                f"{config.joint}: is at {self._start:.2f} rad, too near the end of commands, ±{largest:.2f}"
            )

    @property
    def position(self) -> float:
        """rad, as reported last."""
        return float(self._link.readings().position[0])

    def run(self, others: Iterable[int]) -> tuple[float, dict[int, float]]:
        """Return rad by which the joint moved, and other motors' positions, rad, while it was there."""
        there: dict[int, float] = {}
        moved, begin = 0.0, time.monotonic()
        self._bench.take_answers()  # late ones to earlier questions
        while (elapsed := time.monotonic() - begin) < 2.0 * _RAMP + _HOLD:
            phase = min(elapsed / _RAMP, 1.0, (2.0 * _RAMP + _HOLD - elapsed) / _RAMP)
            self._command(0.5 - 0.5 * math.cos(math.pi * phase))
            missing = [i for i in others if i not in there]
            if phase == 1.0:
                moved = self.position - self._start
                there.update(self._bench.poll_values(_POSITION, missing, 0.0))
        self._command(0.0)  # where the program was slow, the last command is short of it
        return moved, there

    def _command(self, share: float) -> None:
        """Command a share of the way, and wait for a period. Raises `RobotError` if something is wrong.

        A commanded position that would ask for more torque than allowed is moved towards the joint.
        """
        link, wanted = self._link, self._start + share * self._step
        reading = link.readings()
        gains = self._doubt[0] * self._stiffness, self._doubt[1] * self._damping
        command = MITCommand(*(np.array([value]) for value in (wanted, 0.0, 0.0, *gains)))
        limit = np.array([self._config.torque])
        bounded: FloatArray = bounded_position(command, reading.position, reading.velocity, limit, 2.0 * _PERIOD)
        link.command(np.array([[bounded[0]], [0.0], [0.0], [self._stiffness], [self._damping]]))
        time.sleep(_PERIOD)
        checks, name = CheckList(), self._config.joint
        self._bench.line.check(checks)
        for finding in link.findings(self._begin):
            checks.problem(name, finding.text)
        status = link.status()
        if status is not None and status.level is SafetyLevel.FAULT:
            checks.problem(name, status.message)
        checks.refuse()
        if self._bench.line.clock() - link.readings().time[0] > _PATIENCE:
            raise silence(self._bench, self._place[0], f"motor {self._place[1]} does not answer")
        moved = self.position - self._start
        if abs(moved) > _FARTHEST * self._config.angle:
            raise RobotError(f"{name}: has moved by {moved:+.2f} rad: let go")


def _store(
    config: Identify, entries: dict[str, CalibrationEntry], new: CalibrationEntry, names: tuple[str, ...]
) -> bool:
    """Ask which way it went, and store the answer; False if a person denies the direction."""
    name, old = config.joint, entries.get(config.joint)
    if not sys.stdin.isatty():
        print(f"{name}: its direction is not stored: no person confirms it where standard input is not a terminal")
        return True
    is_confirmed = answers_yes(f"Did {name} go the way of a rising angle in the robot's model?")
    if old is not None and (old.id, old.direction) == (new.id, new.direction):
        new = msgspec.structs.replace(new, homing_offset=old.homing_offset)
    if is_confirmed:
        entries[name] = new
    else:
        complain(f"warning: {name}: not confirmed: if it went the other way, its direction in the robot file is wrong")
        if old is None or not old.direction_confirmed:
            return False
        entries[name] = msgspec.structs.replace(old, direction_confirmed=False)
        if old.homing_offset is None:
            del entries[name]
    save_calibration(config.output, entries, names)
    print(f"wrote {config.output}: direction of {name} {'confirmed' if is_confirmed else 'not confirmed'}")
    return is_confirmed
