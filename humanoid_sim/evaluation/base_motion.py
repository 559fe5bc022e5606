"""How the base of a free-standing robot moved: speed, height, tilt and whether it fell; in constant memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.evaluation.failure import has_fallen
from humanoid_sim.simulation.floating_base import BaseState

__all__ = ["BaseMotion", "BaseSummary"]

_SETTLING = 2.0
"""s after release that means leave out: the robot starts from rest."""


@dataclass(frozen=True, slots=True)
class BaseSummary:
    """Figures of the base from its release on. Speeds are means from 2 s after release, NaN for a shorter run."""

    released: float
    """s, robot's clock."""
    duration: float
    """s from release to the end, or to the fall."""
    velocity: tuple[float, float]
    """m/s, forward and to the left, in the frame of the base's heading."""
    yaw_rate: float
    """rad/s"""
    height: tuple[float, float, float]
    """m, least, mean and greatest, from release on."""
    tilt_max: float
    """rad"""
    fall: float | None
    """s after release at which the robot fell; None if it did not."""


class BaseMotion:
    """Accumulates `BaseSummary` from the ticks in which the base is free."""

    def __init__(self) -> None:
        """Nothing was seen yet."""
        self._released: float | None = None
        self._last = 0.0
        self._height_at_release = 0.0
        self._speed_sum = np.zeros(3)
        self._speed_count = 0
        self._height = (math.inf, 0.0, -math.inf)
        self._count = 0
        self._tilt = 0.0
        self._fall: float | None = None

    def update(self, time: float, base: BaseState) -> None:
        """Take one tick with a free base; `time` in s, robot's clock."""
        height, tilt = float(base.height), float(base.tilt)
        if self._released is None:
            self._released, self._height_at_release = time, height
        if self._fall is not None:
            return
        self._last = time
        self._tilt = max(self._tilt, tilt)
        low, total, high = self._height
        self._height = (min(low, height), total + height, max(high, height))
        self._count += 1
        if has_fallen(base, self._height_at_release):
            self._fall = time - self._released
        elif time - self._released >= _SETTLING:
            self._speed_sum += base.planar_velocity
            self._speed_count += 1

    def summary(self) -> BaseSummary | None:
        """The figures so far; None if the base was never free."""
        if self._released is None:
            return None
        speed = self._speed_sum / self._speed_count if self._speed_count else np.full(3, np.nan)
        low, total, high = self._height
        return BaseSummary(
            released=self._released,
            duration=self._last - self._released,
            velocity=(float(speed[0]), float(speed[1])),
            yaw_rate=float(speed[2]),
            height=(low, total / self._count, high),
            tilt_max=self._tilt,
            fall=self._fall,
        )
