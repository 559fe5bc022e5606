"""From what the motors report to the joints' state: turns, direction, offset, and positions that lost their meaning."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.robot.table import Readings
from humanoid_sim.hardware.robot.turns import WRAP, has_jumped, unwrapped
from humanoid_sim.hardware.robot.wiring import Wiring
from humanoid_sim.mit import FloatArray

__all__ = ["JointReadings", "JointTracker", "unheard"]

_TURN = 2.0 * math.pi


class JointReadings:
    """The joints' state as far as it is known. Arrays of shape (n,), joint frame."""

    __slots__ = ("effort", "position", "time", "velocity")

    def __init__(self, time: FloatArray, position: FloatArray, velocity: FloatArray, effort: FloatArray) -> None:
        self.time = time
        """s, robot's clock; -infinity: never heard."""
        self.position = position
        """rad; NaN: never heard, or on an unknown turn."""
        self.velocity = velocity
        """rad/s; 0 where never heard."""
        self.effort = effort
        """N·m; 0 where never heard."""


def unheard(joint_count: int) -> JointReadings:
    """The state of joints of which nothing is known."""
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
        """The joints' state of these readings."""
        wiring, last = self._wiring, self._last
        position = readings.position
        if last is not None:
            position = unwrapped(position, last.position)
            self.jumped = self.jumped | has_jumped(
                position - last.position,
                readings.time - last.time,
                readings.velocity,
                last.velocity,
                wiring.fastest,
            )
            self.wrapped = np.abs(position) > 0.5 * WRAP * (1.0 + 1e-4)  # raw 65535 reads a little beyond
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
