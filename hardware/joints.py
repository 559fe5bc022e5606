"""Joints and their motors: which motor drives which joint, the calibration law, turns, and positions that jumped.

    read:   q_joint = direction · (q_motor − offset)       write:  q_motor = direction · q_joint + offset

A motor's count of turns starts anew at power-on, and what it reports wraps at the ends of its range: a Robstride's at
±4π, a Sito's nowhere that a joint gets to.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motor_link import Motor, Readings
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, bounded_position
from humanoid_sim.robots.motors import FAMILIES, MOTORS
from humanoid_sim.robots.schema import RobotDescription

_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True, eq=False)
class Wiring:
    """A robot's motors in its joint order, with what maps their frame to the joints'. Arrays of shape (n,)."""

    names: tuple[str, ...]  # of the joints
    motors: tuple[Motor, ...]
    direction: FloatArray  # ±1
    offset: FloatArray  # rad, motor frame, homing offset
    lower: FloatArray  # rad, joint frame
    upper: FloatArray  # rad, joint frame
    effort_limit: FloatArray  # N·m, within the motors' range
    fastest: FloatArray  # rad/s, infinite where nobody knows how fast a motor can turn
    position_range: FloatArray  # rad, motor frame, beyond which a report wraps
    highest: FloatArray  # shape (5, n), the ends of the ranges of a command, see `MotorLink.command`
    stiffness_doubt: FloatArray  # the most that a motor may make of a commanded K_p, as a factor
    damping_doubt: FloatArray  # likewise of K_d

    @property
    def endless(self) -> tuple[int, ...]:
        """Joints whose motors execute their last command for ever when their host is silent."""
        return tuple(i for i, motor in enumerate(self.motors) if not FAMILIES[motor.model.family].has_timeout)

    @property
    def unasked(self) -> tuple[int, ...]:
        """Joints whose motors cannot be asked who and where they are."""
        return tuple(i for i, motor in enumerate(self.motors) if not FAMILIES[motor.model.family].has_questions)


def make_wiring(
    description: RobotDescription, channel_count: int, calibration: Mapping[str, float] | None = None
) -> Wiring:
    """Return the wiring of a robot over one channel that carries all motors, or over one channel per bus of the robot.

    `calibration`: homing offset of every joint, rad, motor frame; None: 0 for all.
    """
    name, joints = description.name, description.joint_names
    motors = [joint.motor for joint in description.joints if joint.motor is not None]
    if len(motors) < description.joint_count:
        without = ", ".join(joint.name for joint in description.joints if joint.motor is None)
        raise InputError(f"{name}: these joints have no motor in the robot description: {without}")
    buses = sorted({motor.bus for motor in motors})
    if channel_count not in {1, len(buses)}:
        listed = ", ".join(map(str, buses))
        raise InputError(f"{name}: {channel_count} channels given, expected 1, or one for each of its buses {listed}")
    offsets = dict.fromkeys(joints, 0.0) if calibration is None else calibration
    models = [MOTORS[motor.model] for motor in motors]
    families = [FAMILIES[model.family] for model in models]
    places = [(buses.index(motor.bus) if channel_count > 1 else 0, motor.can_id) for motor in motors]
    limits = [(motor.torque_limit or 0.0, motor.current_limit or 0.0) for motor in motors]
    rows = zip(joints, places, models, limits, description.mode_damping.tolist(), strict=True)
    return Wiring(
        names=joints,
        motors=tuple(Motor(joint, *place, model, *limit, damping) for joint, place, model, limit, damping in rows),
        direction=np.array([float(motor.direction) for motor in motors]),
        offset=np.array([offsets[joint] for joint in joints]),
        lower=description.lower,
        upper=description.upper,
        effort_limit=np.minimum([joint.effort_limit for joint in description.joints], [m.effort for m in models]),
        fastest=np.array([max(model.velocity, model.no_load_velocity) for model in models]),
        position_range=np.array([model.position for model in models]),
        highest=np.array([[getattr(model, name) for model in models] for name in COMMAND_FIELDS]),
        stiffness_doubt=np.array([family.stiffness_doubt for family in families]),
        damping_doubt=np.array([family.damping_doubt for family in families]),
    )


class JointReadings(NamedTuple):
    """The joints' state as far as it is known. Arrays of shape (n,), joint frame."""

    time: FloatArray  # s, robot's clock; -infinity: never received
    position: FloatArray  # rad; NaN: never received, or on an unknown turn
    velocity: FloatArray  # rad/s; 0 where never received
    effort: FloatArray  # N·m; 0 where never received


class JointTracker:
    """Follows the motors' positions over wraps, and notices when one cannot be believed any more."""

    def __init__(self, wiring: Wiring, turns: FloatArray) -> None:
        """Start with the turns that `find_turns` found, shape (n,)."""
        self._wiring = wiring
        self._shift = _TURN * turns
        self._last: Readings | None = None
        self.jumped: npt.NDArray[np.bool_] = np.zeros(len(turns), dtype=bool)
        """Shape (n,): positions that moved as no motor can. The zero went with it: this stays until re-activation."""
        self.wrapped: npt.NDArray[np.bool_] = np.zeros(len(turns), dtype=bool)
        """Shape (n,): motors beyond the end of their range, where no command can follow."""

    def update(self, readings: Readings) -> JointReadings:
        """Return the joints' state of these readings."""
        wiring, last, position = self._wiring, self._last, readings.position
        if last is not None:
            period = 2.0 * wiring.position_range
            periods = np.round((last.position - position) / period)
            position = position + period * np.where(np.isfinite(periods), periods, 0.0)
            self.jumped = self.jumped | _has_jumped(last, readings._replace(position=position), wiring.fastest)
            self.wrapped = np.abs(position) > wiring.position_range * (1.0 + 1e-4)  # raw 65535 reads a little beyond
        self._last = readings._replace(position=position)
        is_known = np.isfinite(readings.time)
        return JointReadings(
            time=np.where(is_known, readings.time, -np.inf),
            position=wiring.direction * (position + self._shift - wiring.offset),
            velocity=np.where(is_known, wiring.direction * readings.velocity, 0.0),
            effort=np.where(is_known, wiring.direction * readings.effort, 0.0),
        )

    def to_motor(self, position: FloatArray) -> FloatArray:
        """Return joint positions, shape (n,), rad, as the motors count them."""
        return self._wiring.direction * position + self._wiring.offset - self._shift


_RESOLUTION = 0.05  # rad that a position may move without any velocity: play, quantisation, a motor's own filter
_TIME_ERROR = 0.04  # s by which two frames may have changed places or been stamped wrongly
_ACCELERATION = 1000.0  # rad/s², more than any of these motors gives a joint: 5.5 N·m on a hand of 5.5e-3 kg·m²


def _has_jumped(last: Readings, now: Readings, fastest: FloatArray) -> npt.NDArray[np.bool_]:
    """Return where a position moved by more than its velocity explains, shape (n,); False where anything is NaN.

    Between two frames a joint moves by the mean of its velocities times the time, to within a quarter of its
    acceleration times the time squared. So what is found at rest is a jump of 0.15 rad within 20 ms.
    """
    moved, elapsed = now.position - last.position, now.time - last.time
    speed, time = np.maximum(np.abs(now.velocity), np.abs(last.velocity)), np.abs(elapsed)
    surprise = np.abs(moved - 0.5 * (now.velocity + last.velocity) * elapsed)
    allowed = speed * _TIME_ERROR + 0.25 * _ACCELERATION * time**2 + _RESOLUTION
    possible = fastest * (time + _TIME_ERROR) + _RESOLUTION
    jumped: npt.NDArray[np.bool_] = (surprise > allowed) | (np.abs(moved) > possible)
    return jumped


_SIGNED = np.array([[-1.0], [-1.0], [-1.0], [0.0], [0.0]])  # gains begin at 0


def motor_values(
    wiring: Wiring, command: MITCommand, state: JointReadings, tracker: JointTracker, lead: float
) -> FloatArray:
    """Return a finite command in the motor frame, within limits and ranges, shape (5, n), see `MotorLink.command`.

    No manual says that a motor's own limit covers the sum of the MIT law: see `bounded_position`, also for the `lead`.
    """
    limit, direction = wiring.effort_limit, wiring.direction
    effort = np.clip(command.effort, -limit, limit)
    stiffness, damping = wiring.stiffness_doubt * command.stiffness, wiring.damping_doubt * command.damping
    limited = MITCommand(command.position, command.velocity, effort, stiffness, damping)
    position = tracker.to_motor(bounded_position(limited, state.position, state.velocity, limit, lead))
    values = np.array([position, direction * command.velocity, direction * effort, command.stiffness, command.damping])
    clipped: FloatArray = np.clip(values, wiring.highest * _SIGNED, wiring.highest)
    return clipped


MARGIN = 0.35  # rad beyond a joint's limits that a joint may lean into its stop, or a calibration may be off
_MOST_TURNS = 3  # either way: ±4π and a homing offset of one turn


def find_turns(wiring: Wiring, position: FloatArray) -> FloatArray:
    """Return turns that have to be added to each motor's own count for its joint to lie within its limits.

    At power-on a motor knows its angle within one turn only, 0..2π by default: a joint left at −0.1 rad reads 6.18. As
    long as a joint's range and twice the margin fit into one turn, at most one count is possible.

    `position`: shape (n,), rad, motor frame, as reported. Returns shape (n,), whole numbers; NaN where no count is
    possible, where two are, or where the position is not known; 0 for a joint without limits.
    """
    turns = np.arange(-_MOST_TURNS, _MOST_TURNS + 1)[:, None]
    joint = wiring.direction * (position + _TURN * turns - wiring.offset)
    fits = (joint >= wiring.lower - MARGIN) & (joint <= wiring.upper + MARGIN)
    only = np.where(fits.sum(axis=0) == 1, turns[np.argmax(fits, axis=0), 0], np.nan)
    unlimited = np.isinf(wiring.lower) & np.isinf(wiring.upper) & np.isfinite(position)
    return np.where(unlimited, 0.0, only)


def check_positions(wiring: Wiring, joints: Iterable[int], position: FloatArray, checks: CheckList) -> None:
    """Note where these joints are, or why that is not known; `position` as for `find_turns`."""
    turns = find_turns(wiring, position)
    angle = wiring.direction * (position + _TURN * np.nan_to_num(turns) - wiring.offset)
    ends = np.array([wiring.lower, wiring.upper])
    reach = np.abs(wiring.direction * ends + wiring.offset - _TURN * turns).max(axis=0)
    for i in joints:
        name, limits = wiring.names[i], f"{wiring.lower[i]:g} to {wiring.upper[i]:g} rad"
        if not math.isfinite(position[i]):
            checks.problem(name, "has not reported its position")
        elif not math.isfinite(turns[i]):
            is_wide = wiring.upper[i] - wiring.lower[i] + 2.0 * MARGIN > _TURN
            text = "on more than one turn: move it to their middle" if is_wide else "on any turn: calibrate it"
            checks.problem(name, f"is at {angle[i]:.2f} rad, {'' if is_wide else 'not '}within {limits} {text}")
        elif wiring.position_range[i] < reach[i] < math.inf:
            text = f"needs commands of {reach[i]:.2f} rad, which reach {wiring.position_range[i]:.2f}"
            checks.problem(name, f"{text}: switch the motor off and on, or set its zero")
        else:
            counts = f" ({turns[i]:+.0f} turn)" if turns[i] else ""
            checks.passed(name, f"at {angle[i]:.3f} rad = {np.rad2deg(angle[i]):.1f}°{counts}")
