"""Joint state from the motors' reports: turns, direction, offset, and positions that lost their meaning.

A motor's count of turns starts anew at power-on, and what it reports wraps at the ends of its range: a Robstride's at
±4π, a Sito's nowhere that a joint gets to.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.adapter.wiring import Wiring
from humanoid_sim.hardware.motors import Readings
from humanoid_sim.mit import FloatArray

_TURN = 2.0 * math.pi


class JointReadings(NamedTuple):
    """The joints' state as far as it is known. Arrays of shape (n,), joint frame."""

    time: FloatArray
    """s, robot's clock; -infinity: never heard."""
    position: FloatArray
    """rad; NaN: never heard, or on an unknown turn."""
    velocity: FloatArray
    """rad/s; 0 where never heard."""
    effort: FloatArray
    """N·m; 0 where never heard."""


def unheard(joint_count: int) -> JointReadings:
    """Return the state of joints of which nothing is known."""
    zeros = np.zeros(joint_count)
    return JointReadings(np.full(joint_count, -np.inf), np.full(joint_count, np.nan), zeros, zeros)


class JointTracker:
    """Follows the motors' positions over wraps, and notices when one cannot be believed any more."""

    def __init__(self, wiring: Wiring, turns: FloatArray) -> None:
        """Start with the turns that `find_turns` found, shape (n,), NaN where not known."""
        self._wiring = wiring
        self._shift = _TURN * turns
        self._last: Readings | None = None
        self.jumped: npt.NDArray[np.bool_] = np.zeros(wiring.count, dtype=bool)
        """Shape (n,): positions that moved as no motor can. The zero went with it: this stays until re-activation."""
        self.wrapped: npt.NDArray[np.bool_] = np.zeros(wiring.count, dtype=bool)
        """Shape (n,): motors beyond ±4π, where no command can follow."""

    def update(self, readings: Readings) -> JointReadings:
        """Return the joints' state of these readings."""
        wiring, last = self._wiring, self._last
        position = readings.position
        if last is not None:
            position = unwrapped(position, last.position, 2.0 * wiring.position_range)
            self.jumped = self.jumped | has_jumped(
                position - last.position, readings.time - last.time, readings.velocity, last.velocity, wiring.fastest
            )
            self.wrapped = np.abs(position) > wiring.position_range * (1.0 + 1e-4)  # raw 65535 reads a little beyond
        self._last = Readings(readings.time, position, readings.velocity, readings.effort, readings.temperature)
        heard = np.isfinite(readings.time)
        joint = wiring.direction * (position + self._shift - wiring.offset)
        return JointReadings(
            time=np.where(heard, readings.time, -np.inf),
            position=joint,
            velocity=np.where(heard, wiring.direction * readings.velocity, 0.0),
            effort=np.where(heard, wiring.direction * readings.effort, 0.0),
        )

    def to_motor(self, position: FloatArray) -> FloatArray:
        """Joint positions, shape (n,), rad, as the motors count them."""
        return self._wiring.direction * position + self._wiring.offset - self._shift


MARGIN = 0.35
"""rad beyond a joint's limits that a joint may lean into its stop, or a calibration may be off."""

_MOST_TURNS = 3
"""Turns either way that are looked at: ±4π and a homing offset of one turn."""


def find_turns(wiring: Wiring, position: FloatArray) -> FloatArray:
    """Return turns that have to be added to each motor's own count for its joint to lie within its limits.

    At power-on a motor knows its angle within one turn only, 0..2π by default: a joint left at −0.1 rad reads 6.18. As
    long as a joint's range and twice the margin fit into one turn, at most one count is possible.

    Args:
        position: shape (n,), rad, motor frame, as reported.

    Returns:
        Shape (n,), whole numbers; NaN where no count is possible, where two are, or where the position is not known.
        For a joint without limits 0.
    """
    turns = np.arange(-_MOST_TURNS, _MOST_TURNS + 1)[:, None]
    joint = wiring.direction * (position + _TURN * turns - wiring.offset)
    fits = (joint >= wiring.lower - MARGIN) & (joint <= wiring.upper + MARGIN)
    only = np.where(fits.sum(axis=0) == 1, turns[np.argmax(fits, axis=0), 0], np.nan)
    unlimited = np.isinf(wiring.lower) & np.isinf(wiring.upper) & np.isfinite(position)
    return np.where(unlimited, 0.0, only)


def turn_problems(wiring: Wiring, position: FloatArray, turns: FloatArray) -> Iterator[tuple[str, str]]:
    """Joint and what is wrong with its position, where `find_turns` found no count or commands cannot reach."""
    for i, name in enumerate(wiring.names):
        lower, upper, reported = wiring.lower[i], wiring.upper[i], position[i]
        if not math.isfinite(reported):
            yield name, "has not told its position"
        elif not math.isfinite(turns[i]):
            joint = wiring.direction[i] * (reported - wiring.offset[i])
            middle = 0.5 * (lower + upper)
            nearest = middle + math.remainder(joint - middle, _TURN)
            if upper - lower + 2.0 * MARGIN >= _TURN and lower - MARGIN <= nearest <= upper + MARGIN:
                yield (
                    name,
                    f"may be on more than one turn: its range, {lower:g} to {upper:g} rad, is almost a whole one",
                )
            else:
                yield (
                    name,
                    f"is at {nearest:.2f} rad, outside its range of {lower:g} to {upper:g} rad on any turn: calibrate "
                    "it, or check its direction",
                )
        elif math.isfinite(lower) and math.isfinite(upper):
            ends = wiring.direction[i] * np.array([lower, upper]) + wiring.offset[i] - _TURN * turns[i]
            if np.abs(ends).max() > wiring.position_range[i]:
                yield (
                    name,
                    f"its range is {ends.min():.2f} to {ends.max():.2f} rad at the motor, commands reach "
                    f"±{wiring.position_range[i]:.2f}: switch the motor off and on, or set its zero",
                )


def unwrapped(position: FloatArray, previous: FloatArray, period: FloatArray) -> FloatArray:
    """Return reported positions, moved by whole periods to where they are nearest to the previous ones.

    Args:
        position: shape (n,), rad, motor frame, within half a period of 0; NaN stays NaN.
        previous: shape (n,), rad, motor frame, unwrapped; NaN: take the position as it is.
        period: shape (n,), rad, with which reported positions repeat.
    """
    periods = np.round((previous - position) / period)
    return position + period * np.where(np.isfinite(periods), periods, 0.0)


_RESOLUTION = 0.05
"""rad that a position may move without any velocity: play, quantisation, a motor's own filter."""
_TIME_ERROR = 0.04
"""s by which two frames may have changed places or been stamped wrongly."""
_ACCELERATION = 1000.0
"""rad/s², more than any of these motors gives a joint: 5.5 N·m on a hand of 5.5e-3 kg·m²."""


def has_jumped(
    moved: FloatArray, elapsed: FloatArray, velocity: FloatArray, previous_velocity: FloatArray, fastest: FloatArray
) -> npt.NDArray[np.bool_]:
    """Tell whether a position moved by more than its velocity explains: an encoder lost its place, and its zero.

    Between two frames a joint moves by the mean of its velocities times the time, to within a quarter of its
    acceleration times the time squared. So what is found at rest is a jump of 0.15 rad within 20 ms.

    Args:
        moved: shape (n,), rad, since the previous frame.
        elapsed: shape (n,), s, since then.
        velocity: shape (n,), rad/s, as reported with the position.
        previous_velocity: shape (n,), rad/s, as reported before.
        fastest: shape (n,), rad/s, the motors' largest.

    Returns:
        Shape (n,), boolean; False where anything is NaN.
    """
    speed = np.maximum(np.abs(velocity), np.abs(previous_velocity))
    time = np.abs(elapsed)
    surprise = np.abs(moved - 0.5 * (velocity + previous_velocity) * elapsed)
    allowed = speed * _TIME_ERROR + 0.25 * _ACCELERATION * time**2 + _RESOLUTION
    possible = fastest * (time + _TIME_ERROR) + _RESOLUTION
    jumped: npt.NDArray[np.bool_] = (surprise > allowed) | (np.abs(moved) > possible)
    return jumped
