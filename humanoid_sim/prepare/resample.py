"""Another frame rate for a motion, by interpolation; only ever on request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import slerp
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import NamedMotion

__all__ = ["has_rate", "resample"]

_EQUAL = 1e-4
"""Relative difference of rates that writing them as decimals explains: half a frame in a hundred seconds at 50 Hz."""


def has_rate(fps: float, policy_dt: float) -> bool:
    """Whether frames come once per policy step."""
    return abs(fps * policy_dt - 1.0) <= _EQUAL


def resample(motion: NamedMotion, policy_dt: float) -> NamedMotion:
    """The motion with a frame every `policy_dt` s, from its first frame to at most its last.

    Positions are interpolated linearly, orientations along the shortest arc, joint velocities as they are: rates per
    second.
    """
    count = next(len(array) for array in (motion.joint_position, motion.body_position) if array is not None)
    # The margin keeps the last frame where both rates fall together but for rounding.
    frames = int(np.floor((count - 1) / motion.fps / policy_dt + 1e-6)) + 1
    place = np.minimum(np.arange(frames) * policy_dt * motion.fps, count - 1)
    lower = np.minimum(place.astype(np.intp), max(count - 2, 0))
    weight = place - lower

    def linear(array: FloatArray | None) -> FloatArray | None:
        if array is None:
            return None
        w = _beside(weight, array)
        mixed: FloatArray = (1.0 - w) * array[lower] + w * array[np.minimum(lower + 1, count - 1)]
        return mixed

    def spherical(array: FloatArray | None) -> FloatArray | None:
        if array is None:
            return None
        return slerp(array[lower], array[np.minimum(lower + 1, count - 1)], _beside(weight, array))

    return replace(
        motion,
        fps=1.0 / policy_dt,
        joint_position=linear(motion.joint_position),
        joint_velocity=linear(motion.joint_velocity),
        body_position=linear(motion.body_position),
        body_quaternion=spherical(motion.body_quaternion),
        base_position=linear(motion.base_position),
        base_quaternion=spherical(motion.base_quaternion),
    )


def _beside(weight: npt.NDArray[np.float64], array: FloatArray) -> FloatArray:
    """Weights (F,) as a column for arrays (F, …)."""
    return weight.reshape(-1, *[1] * (array.ndim - 1))
