"""Loss of a robot: it has fallen, or strayed from the motion that it follows. The only definition, for all judges."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.mit import BoolArray, FloatArray
from humanoid_sim.simulation.floating_base import BaseState

Index = int | tuple[()]
"""Index of a robot of a batch; () for the only one."""

FALLEN_TILT = 1.0  # rad between the vertical and the axis of a floating base that points up where the robot stands
FALLEN_HEIGHT = 0.6  # share of the standing height of the centre of mass: the base's frame may lie anywhere on a robot
STRAYED_DISTANCE = 0.3  # m between a tracked body and its reference in the base frame
STRAYED_HEIGHT = 0.35  # m between the anchor body and its reference, along the vertical
STRAYED_TILT = 1.2  # rad between the two, without the heading: a reference that is not aligned is not yet a loss
_RUNAWAY = 100.0  # rad/s: no motor of a humanoid is as fast; a simulation that is about to diverge is


def total(values: npt.NDArray[Any]) -> FloatArray:
    """Return the sum over the last axis; for one robot in half the time of `values.sum(axis=-1)`."""
    return np.asarray(np.add.reduce(values, axis=-1, dtype=np.float64))


def length(vectors: FloatArray) -> FloatArray:
    """Return the length of vectors along the last axis."""
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square over the last axis."""
    return np.asarray(np.sqrt(np.vecdot(values, values) / values.shape[-1]))


def quaternion_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angle between unit quaternions (..., 4) of either sign: shape (...), rad, in [0, π]."""
    # by the chord 2 sin(angle / 4): accurate near zero, unlike the arc cosine of their product
    chord = a - np.copysign(1.0, np.vecdot(a, b))[..., None] * b
    return np.asarray(4.0 * np.arcsin(np.minimum(0.5 * length(chord), 1.0)))


def tilt_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angle between unit quaternions (..., 4) without the heading: shape (...), rad, in [0, π]."""
    return np.asarray(2.0 * np.arcsin(np.minimum(length(multiply(conjugate(a), b)[..., 1:3]), 1.0)))


def has_fallen(base: BaseState, standing_height: FloatArray | float) -> BoolArray:
    """Return which floating bases have fallen, shape (...).

    `standing_height`, shape (...) or scalar, m, is that of the centre of mass above the floor where the robot stands.
    """
    return np.asarray((base.tilt > FALLEN_TILT) | (base.mass_height < FALLEN_HEIGHT * standing_height))


def describe_fall(base: BaseState, standing_height: FloatArray | float, i: Index = ()) -> str:
    """Return how robot `i` fell; the others as of `has_fallen`."""
    tilt, share = np.degrees(base.tilt)[i], np.asarray(base.mass_height / standing_height)[i]
    return f"fell: tilted by {tilt:.0f}°, its centre of mass at {share:.0%} of its standing height"


def has_run_away(joint_velocity: FloatArray) -> BoolArray:
    """Return which robots' joints, shape (..., n), rad/s, are faster than any robot's, shape (...): a fault."""
    return np.asarray(np.abs(joint_velocity).max(axis=-1) > _RUNAWAY)


def has_strayed(pose: FloatArray, position: FloatArray, quaternion: FloatArray) -> BoolArray:
    """Return which anchor bodies are too far from the motion, shape (...); NaN is.

    Poses (..., 7), m and w x y z, against (..., 3) and (..., 4), all world frame.
    """
    height, tilt = np.abs(position[..., 2] - pose[..., 2]), tilt_between(pose[..., 3:], quaternion)
    return np.asarray(~((height <= STRAYED_HEIGHT) & (tilt <= STRAYED_TILT)))


def describe_stray(pose: FloatArray, position: FloatArray, quaternion: FloatArray) -> str:
    """Return how one robot strayed, by its anchor body; arguments as of `has_strayed`."""
    tilt = math.degrees(tilt_between(pose[3:], quaternion))
    return f"strayed: {abs(position[2] - pose[2]):.2f} m off the motion's height, tilted by {tilt:.0f}° against it"


def body_has_strayed(distance: FloatArray) -> BoolArray:
    """Return whether any tracked body, distances (..., b), m, is too far from the motion, shape (...); NaN is."""
    return np.asarray(~(np.maximum.reduce(distance, axis=-1) <= STRAYED_DISTANCE))


def describe_body_stray(distance: FloatArray, bodies: tuple[str, ...]) -> str:
    """Return how one robot strayed, by the distances of its tracked bodies, shape (b,), m."""
    worst = int(np.argmax(np.where(np.isnan(distance), np.inf, distance)))
    return f"strayed: {bodies[worst]} is {distance[worst]:.2f} m from the motion"
