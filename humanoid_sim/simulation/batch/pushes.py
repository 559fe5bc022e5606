"""Pushes that come at random, of robots with a floating base."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.push import PUSH_DURATION

__all__ = ["RandomPushes"]


class RandomPushes:
    """One push of `PUSH_DURATION` in each stretch of `push_interval`, at a moment and in a direction that are drawn."""

    def __init__(self, draws: Draws, mass: float, control_period: float) -> None:
        """Set up.

        Args:
            draws: of the N environments; their randomisation has pushes.
            mass: kg, of the robot as its model is.
            control_period: s.
        """
        self._draws, self._mass, self._period = draws, mass, control_period
        self._interval = max(round(draws.randomisation.push_interval / control_period), 1)
        self._duration = min(max(round(PUSH_DURATION / control_period), 1), self._interval)

    def wrench(self, step: npt.NDArray[np.int64]) -> FloatArray:
        """Force and torque in the control periods that begin now, shape (N, 6), N and N·m, world frame.

        Args:
            step: shape (N,), control periods since each environment's start.
        """
        draws = self._draws
        stretch, since = np.divmod(step, self._interval)
        moment, direction, strength = draws.shares("push", stretch, 3).T
        begin = np.floor(moment * (self._interval - self._duration + 1))
        low, high = draws.randomisation.push
        speed = (low + (high - low) * strength) * draws.amount("push")[:, 0]
        lasts = (begin <= since) & (since < begin + self._duration)
        force = np.where(lasts, self._mass * speed / (self._duration * self._period), 0.0)
        wrench = np.zeros((len(step), 6))
        wrench[:, 0] = force * np.cos(2.0 * np.pi * direction)
        wrench[:, 1] = force * np.sin(2.0 * np.pi * direction)
        return wrench
