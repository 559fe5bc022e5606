"""Loss of a robot: it has fallen, or strayed from the motion that it follows. The only definition, for all judges."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from humanoid_sim.evaluation.errors import PoseError
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
_TOPPLED = math.radians(45.0)  # rad of tilt from which a fall is described as one by tilt

DEFINITIONS: Mapping[str, str] = {
    "fall": f"the centre of mass is below {FALLEN_HEIGHT:g} of the height above the floor at which it stands, or "
    f"the axis of the base that then points up leans by more than {FALLEN_TILT:g} rad",
    "loss": f"a tracked body is more than {STRAYED_DISTANCE:g} m from the motion, or the anchor body is more than "
    f"{STRAYED_HEIGHT:g} m off its height or leans by more than {STRAYED_TILT:g} rad against it",
    "errors": "the pose in the very tick in which a frame is shown, less that frame; each frame once, the last too",
}
"""By name; only figures of equal definitions are compared."""


def differing(recorded: Mapping[str, str]) -> tuple[str, ...]:
    """Return the names of the definitions that differ from those in a file."""
    return tuple(name for name, text in DEFINITIONS.items() if recorded.get(name) != text)


def has_fallen(base: BaseState, standing_height: FloatArray | float) -> BoolArray:
    """Return which floating bases have fallen, shape (...).

    `standing_height`, shape (...) or scalar, m, is that of the centre of mass above the floor where the robot stands.
    """
    return np.asarray((base.tilt > FALLEN_TILT) | (base.mass_height < FALLEN_HEIGHT * standing_height))


def describe_fall(base: BaseState, standing_height: FloatArray | float, i: Index = ()) -> str:
    """Return how robot `i` fell; the others as of `has_fallen`."""
    tilt, height = float(np.asarray(base.tilt)[i]), float(np.asarray(base.mass_height)[i])
    if tilt > _TOPPLED:
        return f"fell: tilted by {math.degrees(tilt):.0f}°"
    stood = float(np.broadcast_to(standing_height, np.shape(base.mass_height))[i])
    return f"fell: its centre of mass sank to {height:.2f} m, it stood at {stood:.2f} m"


def has_run_away(joint_velocity: FloatArray) -> BoolArray:
    """Return which robots' joints, shape (..., n), rad/s, are faster than any robot's, shape (...): a fault."""
    return np.asarray(np.abs(joint_velocity).max(axis=-1) > _RUNAWAY)


def has_strayed(error: PoseError) -> BoolArray:
    """Return which anchor bodies are too far from the motion, shape (...); NaN is."""
    return np.asarray(~((np.abs(error.offset[..., 2]) <= STRAYED_HEIGHT) & (error.tilt <= STRAYED_TILT)))


def describe_stray(error: PoseError, i: Index = ()) -> str:
    """Return how robot `i` strayed, by its anchor body."""
    tilt, height = float(np.asarray(error.tilt)[i]), float(np.asarray(error.offset[..., 2])[i])
    if abs(height) <= STRAYED_HEIGHT:
        return f"strayed: tilted by {math.degrees(tilt):.0f}° against the motion"
    return f"strayed: {abs(height):.2f} m off the motion's height"


def body_has_strayed(distance: FloatArray) -> BoolArray:
    """Return whether any tracked body, distances (..., b), m, is too far from the motion, shape (...); NaN is."""
    return np.asarray(~(np.maximum.reduce(distance, axis=-1) <= STRAYED_DISTANCE))


def describe_body_stray(distance: FloatArray, bodies: tuple[str, ...]) -> str:
    """Return how one robot strayed, by the distances of its tracked bodies, shape (b,), m."""
    worst = int(np.argmax(np.where(np.isnan(distance), np.inf, distance)))
    return f"strayed: {bodies[worst]} is {distance[worst]:.2f} m from the motion"
