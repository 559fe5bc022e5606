"""How the base of a free-standing robot moved: speed, height, tilt and whether it fell; in constant memory."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.context import BASE_LINEAR_VELOCITY
from humanoid_sim.controllers.rotation import conjugate, gravity_direction, rotate, yaw_quaternion
from humanoid_sim.mit import FloatArray, MITState

__all__ = ["BaseMotion", "BaseSummary"]

_SETTLING = 2.0
"""s after release that means leave out: the robot starts from rest."""
_FALLEN_TILT = math.radians(60.0)
_FALLEN_HEIGHT = 0.5
"""Of the height at release."""


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

    def update(self, state: MITState, base_height: float) -> None:
        """Take one tick with a free base.

        Args:
            state: with `base_linear_velocity` among its live inputs.
            base_height: m, of the base's origin above the world's.
        """
        time = float(state.time)
        if self._released is None:
            self._released, self._height_at_release = time, base_height
        if self._fall is not None:
            return
        self._last = time
        quaternion = state.imu_quaternion
        tilt = math.acos(min(max(-float(gravity_direction(quaternion)[2]), -1.0), 1.0))
        self._tilt = max(self._tilt, tilt)
        low, total, high = self._height
        self._height = (min(low, base_height), total + base_height, max(high, base_height))
        self._count += 1
        if tilt > _FALLEN_TILT or base_height < _FALLEN_HEIGHT * self._height_at_release:
            self._fall = time - self._released
        elif time - self._released >= _SETTLING:
            self._speed_sum += self._speed(state, quaternion)
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

    @staticmethod
    def _speed(state: MITState, quaternion: FloatArray) -> FloatArray:
        """vx, vy in the heading frame, m/s, and the yaw rate, rad/s."""
        velocity = rotate(conjugate(yaw_quaternion(quaternion)), state.extern[BASE_LINEAR_VELOCITY].value)
        yaw_rate = rotate(quaternion, state.imu_angular_velocity)[2]
        return np.array([velocity[0], velocity[1], yaw_rate])
