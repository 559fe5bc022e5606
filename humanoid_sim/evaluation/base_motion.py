"""Motion of a free-standing robot's base: speed, height, tilt and whether it fell; in constant memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.evaluation.failure import describe_fall, has_fallen
from humanoid_sim.simulation.floating_base import BaseState

_SETTLING = 2.0
"""s after release that means and the largest tilt leave out: the robot starts from rest, and sags as it is let go."""


@dataclass(frozen=True, slots=True)
class BaseSummary:
    """Figures of the base from its release on. Speeds are means from 2 s after release; None for a shorter run."""

    released: float
    """s, robot's clock."""
    duration: float
    """s from release to the end, or to the fall."""
    velocity: tuple[float, float] | None
    """m/s, forward and to the left, in the frame of the base's heading."""
    yaw_rate: float | None
    """rad/s"""
    height: tuple[float, float, float]
    """m, of the base's origin above the floor: least, mean and greatest, from landing on; see `BaseMotion`."""
    lowest: float
    """Share of its standing height that the centre of mass had at least above the floor, from release on."""
    tilt_max: float | None
    """rad, from 2 s after release on; None for a shorter run."""
    fall: float | None
    """s after release at which the robot fell; None if it did not."""
    fell: str
    """Description of the fall; empty without one."""


class BaseMotion:
    """Accumulates `BaseSummary` from the ticks in which the base is free.

    The robot has landed once its centre of mass is no higher than it stands, or 2 s after release.
    """

    def __init__(self) -> None:
        self.released: float | None = None
        """s, robot's clock, at which the base was let go; None while it never was."""
        self._standing_height = 0.0
        self._last = 0.0
        self._speed_sum = np.zeros(3)
        self._speed_count = 0
        self._has_landed = False
        self._height = (math.inf, 0.0, -math.inf)
        self._count = 0
        self._lowest = math.inf
        self._tilt: float | None = None
        self._fall: float | None = None
        self._fell = ""

    def release(self, time: float, standing_height: float) -> None:
        """Begin once the base is let go; `time` in s, robot's clock, `standing_height` in m, as of `has_fallen`."""
        self.released, self._standing_height = time, standing_height

    def update(self, time: float, base: BaseState) -> str:
        """Take one tick with a free base; `time` in s, robot's clock. Says how the robot fell in the tick in which."""
        assert self.released is not None
        if self._fall is not None:
            return ""
        self._last = time
        since = time - self.released
        height = float(base.height)
        if not self._has_landed:
            self._has_landed = since >= _SETTLING or float(base.mass_height) <= self._standing_height
            self._height, self._count = (math.inf, 0.0, -math.inf), 0
        low, total, high = self._height
        self._height = (min(low, height), total + height, max(high, height))
        self._count += 1
        self._lowest = min(self._lowest, float(base.mass_height) / self._standing_height)
        if since >= _SETTLING:
            self._tilt = max(self._tilt or 0.0, float(base.tilt))
        if has_fallen(base, self._standing_height):
            self._fall, self._fell = since, describe_fall(base, self._standing_height)
            return self._fell
        if since >= _SETTLING:
            self._speed_sum += base.planar_velocity
            self._speed_count += 1
        return ""

    def summary(self) -> BaseSummary | None:
        """Return the figures so far; None if the base was never free."""
        if self.released is None or not self._count:
            return None
        speed = self._speed_sum / self._speed_count if self._speed_count else None
        low, total, high = self._height
        return BaseSummary(
            released=self.released,
            duration=self._last - self.released,
            velocity=None if speed is None else (float(speed[0]), float(speed[1])),
            yaw_rate=None if speed is None else float(speed[2]),
            height=(low, total / self._count, high),
            lowest=self._lowest,
            tilt_max=self._tilt,
            fall=self._fall,
            fell=self._fell,
        )
