"""Figures of one policy step, in one table: rewards, `regress` and `doctor` choose rows by name.

A row is a function of a `StepContext` c and a `StepSample` s, of one robot or a batch: one value for each, shape (...).
What a fall is, and how far is too far from a motion, is defined here alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.evaluation.step import Needs, StepContext, StepSample
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, BoolArray, FloatArray
from humanoid_sim.simulation.floating_base import BaseState

FALLEN_TILT = 1.0  # rad between the vertical and the axis of a floating base that points up where the robot stands
FALLEN_HEIGHT = 0.6  # share of the standing height of the centre of mass: the base's frame may lie anywhere on a robot
STRAYED_DISTANCE = 0.3  # m between a tracked body and its reference in the base frame
STRAYED_HEIGHT = 0.35  # m between the anchor body and its reference, along the vertical
STRAYED_TILT = 1.2  # rad between the two, without the heading: a reference that is not aligned is not yet a loss

Index = int | tuple[()]  # of a robot of a batch; () for the only one
Values = Callable[[StepContext, StepSample], FloatArray]


@dataclass(frozen=True, slots=True)
class StepMetric:
    """A figure of a policy step."""

    unit: str
    values: Values
    needs: Needs  # part of robot, contract or motion without which it means nothing


# --- vectors, along the last axis ---


def length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def rms(values: FloatArray) -> FloatArray:
    """Return the root mean square."""
    return np.asarray(np.sqrt(np.vecdot(values, values) / values.shape[-1]))


def _total(values: FloatArray) -> FloatArray:
    """Return the sum; for one robot in half the time of `values.sum(axis=-1)`."""
    return np.asarray(np.add.reduce(values, axis=-1, dtype=np.float64))


def _squares(values: npt.NDArray[np.floating]) -> FloatArray:
    return np.asarray(np.vecdot(values, values, dtype=np.float64))


def quaternion_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angle between unit quaternions (..., 4) of either sign: shape (...), rad, in [0, π]."""
    # by the chord 2 sin(angle / 4): accurate near zero, unlike the arc cosine of their product
    chord = a - np.copysign(1.0, np.vecdot(a, b))[..., None] * b
    return np.asarray(4.0 * np.arcsin(np.minimum(0.5 * length(chord), 1.0)))


# --- losses ---


def has_fallen(base: BaseState, standing_height: FloatArray | float) -> BoolArray:
    """Return which floating bases have fallen, shape (...).

    `standing_height`, shape (...) or scalar, m, is that of the centre of mass above the floor where the robot stands.
    """
    return np.asarray((base.tilt > FALLEN_TILT) | (base.mass_height < FALLEN_HEIGHT * standing_height))


def describe_fall(base: BaseState, standing_height: FloatArray | float, i: Index = ()) -> str:
    """Return how robot `i` fell; the others as of `has_fallen`."""
    tilt, share = np.degrees(base.tilt)[i], np.asarray(base.mass_height / standing_height)[i]
    return f"fell: tilted by {tilt:.0f}°, its centre of mass at {share:.0%} of its standing height"


def _strayed(c: StepContext, s: StepSample) -> FloatArray:
    if c.tracked:
        is_near = np.maximum.reduce(_distance(c, s), axis=-1) <= STRAYED_DISTANCE
    else:
        height, tilt = _anchor_stray(c, s)
        is_near = (height <= STRAYED_HEIGHT) & (tilt <= STRAYED_TILT)
    return np.asarray(~is_near, dtype=np.float64)  # NaN has strayed


def _anchor_stray(c: StepContext, s: StepSample) -> tuple[FloatArray, FloatArray]:
    """Return how far the anchor body is off the motion's height, m, and tilted against it, rad; shape (...) each."""
    pose, position, quaternion = _anchor_poses(c, s)
    level = length(multiply(conjugate(pose[..., 3:]), quaternion)[..., 1:3])
    return np.abs(position[..., 2] - pose[..., 2]), 2.0 * np.arcsin(np.minimum(level, 1.0))


def describe_failure(c: StepContext, s: StepSample, i: Index = ()) -> str:
    """Return why robot `i` of a batch, () for the only one, has fallen or strayed."""
    if s.base is not None and has_fallen(s.base, c.standing_height)[i]:
        return describe_fall(s.base, c.standing_height, i)
    if c.tracked:
        distance = _distance(c, s)[i]
        worst = int(np.argmax(np.where(np.isnan(distance), np.inf, distance)))
        return f"strayed: {c.tracked[worst]} is {distance[worst]:.2f} m from the motion"
    height, tilt = (values[i] for values in _anchor_stray(c, s))
    return f"strayed: {height:.2f} m off the motion's height, tilted by {math.degrees(tilt):.0f}° against it"


# --- parts of rows ---


def _distance(c: StepContext, s: StepSample) -> FloatArray:
    """Shape (..., b), m, of the tracked bodies from the motion, base frame."""
    return length(s.body_position - c.body_target[0][c.reference.clamp(s.frame)])


def _angle(c: StepContext, s: StepSample) -> FloatArray:
    """Shape (..., b), rad, between the tracked bodies and the motion."""
    return quaternion_angle(s.body_quaternion, c.body_target[1][c.reference.clamp(s.frame)])


def _anchor_poses(c: StepContext, s: StepSample) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the anchor body's pose (..., 7), and the position and quaternion of the motion laid onto the robot."""
    return s.state.extern[ANCHOR_POSE].value, *c.reference.anchor(s.frame, s.alignment)


def _anchor_distance(c: StepContext, s: StepSample) -> FloatArray:
    pose, position, _ = _anchor_poses(c, s)
    return length(position - pose[..., :3])


def _anchor_angle(c: StepContext, s: StepSample) -> FloatArray:
    pose, _, quaternion = _anchor_poses(c, s)
    return quaternion_angle(pose[..., 3:], quaternion)


def _joint_error(c: StepContext, s: StepSample) -> FloatArray:
    assert c.joint_target is not None
    return rms(s.state.joint_position - c.joint_target[np.minimum(s.frame, len(c.joint_target) - 1)])


def _joint_stops(c: StepContext, s: StepSample) -> FloatArray:
    q = s.state.joint_position
    return _total(np.maximum(np.maximum(c.lowest - q, q - c.highest), 0.0))


def _base(s: StepSample) -> BaseState:
    assert s.base is not None
    return s.base


def _off_command(s: StepSample) -> FloatArray:
    """Shape (..., 3): velocity less its command, m/s, m/s and rad/s, heading frame."""
    return _base(s).planar_velocity - s.command


def _keys(c: StepContext, s: StepSample) -> tuple[BoolArray, BoolArray]:
    """Return which keys are down and which should be, shape (..., 88)."""
    return np.asarray(s.state.extern[KEY_PRESSED].value > 0.5), c.song[c.reference.clamp(s.frame)]


def key_ratios(down: BoolArray, goal: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Precision, recall and F1, shape (...) each: which keys are down and which should be, (..., K).

    As RoboPianist (Zakka et al. 2023) scores time steps. A ratio whose denominator is 0 counts as 1.
    """
    right, pressed, wanted = (down & goal).sum(axis=-1), down.sum(axis=-1), goal.sum(axis=-1)
    return _share(right, pressed), _share(right, wanted), _share(2 * right, pressed + wanted)


def _share(part: npt.NDArray[np.integer], whole: npt.NDArray[np.integer]) -> FloatArray:
    return np.where(whole > 0, part / np.maximum(whole, 1), 1.0)


def _no_wrong_key(c: StepContext, s: StepSample) -> FloatArray:
    pressed, wanted = _keys(c, s)
    return np.where((pressed & ~wanted).any(axis=-1), 0.0, 1.0)


def _key_ratio(which: int) -> Values:
    return lambda c, s: key_ratios(*_keys(c, s))[which]


# --- the table ---

_ROWS: Mapping[Needs, Mapping[str, tuple[str, Values]]] = {
    "": {
        "alive": ("1", lambda _, s: np.ones(s.torque.shape[:-1])),
        "effort": ("N·m", lambda _, s: rms(s.torque)),  # over the joints
        "effort_share": ("1", lambda c, s: _squares(s.torque * c.inverse_effort)),  # sum of (torque / limit)²
        "power": ("W", lambda _, s: _total(np.abs(s.torque * s.state.joint_velocity))),  # sum of |torque · speed|
        "joint_speed": ("rad²/s²", lambda _, s: _squares(s.state.joint_velocity)),
        "joint_stops": ("rad", _joint_stops),  # sum of how far joints are beyond their limits less 0.05 rad
        "action_change": ("action²", lambda _, s: _squares(s.action - s.previous_action)),
    },
    "floating base": {
        "fallen": ("1", lambda c, s: has_fallen(_base(s), c.standing_height).astype(float)),
        "tilt": ("rad", lambda _, s: _base(s).tilt),  # of the axis that points up where it stands
        "lean": ("1", lambda _, s: _squares(_base(s).gravity[..., :2])),  # squared sine of its z axis' tilt
        "vertical_velocity": ("m²/s²", lambda _, s: np.asarray(_base(s).linear_velocity[..., 2] ** 2)),
        "rocking": ("rad²/s²", lambda _, s: _squares(_base(s).angular_velocity[..., :2])),  # w_x² + w_y², base frame
        "velocity_error": ("m/s", lambda _, s: length(_off_command(s)[..., :2])),  # |v - v_command|, horizontal
        "yaw_rate_error": ("rad/s", lambda _, s: np.abs(_off_command(s)[..., 2])),
    },
    "motion": {  # rms over its tracked bodies in the base frame, or of its anchor in the world
        "strayed": ("1", _strayed),
        "body_position_error": ("m", lambda c, s: rms(_distance(c, s)) if c.tracked else _anchor_distance(c, s)),
        "body_orientation_error": ("rad", lambda c, s: rms(_angle(c, s)) if c.tracked else _anchor_angle(c, s)),
    },
    "motion of bodies": {
        "hand_position_error": ("m", lambda c, s: rms(_distance(c, s)[..., c.hands])),
        "hand_orientation_error": ("rad", lambda c, s: rms(_angle(c, s)[..., c.hands])),
    },
    "motion with joints": {"joint_error": ("rad", _joint_error)},  # rms(q - q_motion)
    "motion with an anchor": {
        "anchor_position_error": ("m", _anchor_distance),
        "anchor_orientation_error": ("rad", _anchor_angle),
    },
    "song": {  # recall and no wrong key are the key press reward of RoboPianist (Zakka et al. 2023)
        "no_wrong_key": ("1", _no_wrong_key),  # 1 where no other key is down
        "precision": ("share", _key_ratio(0)),  # of the keys that are down, those that should be
        "recall": ("share", _key_ratio(1)),  # of the keys that should be down, those that are; 1 without any
        "f1": ("share", _key_ratio(2)),  # harmonic mean of precision and recall
    },
}
_CLOSENESS = {  # rewards exp(-(error / scale)²): the error, and the scale in its unit
    "body_position": ("body_position_error", 0.1),
    "body_orientation": ("body_orientation_error", 0.4),
    "joint_position": ("joint_error", 0.3),
    "anchor_position": ("anchor_position_error", 0.3),
    "anchor_orientation": ("anchor_orientation_error", 0.4),
    "linear_velocity": ("velocity_error", 0.25),
    "yaw_rate": ("yaw_rate_error", 0.5),
}


def _closeness(of: str, scale: float) -> StepMetric:
    error = _ERRORS[of]

    def values(c: StepContext, s: StepSample) -> FloatArray:
        return np.asarray(np.exp(-np.square(error.values(c, s) / scale)))

    return StepMetric("1", values, error.needs)


_ERRORS = {name: StepMetric(*row, needs) for needs, rows in _ROWS.items() for name, row in rows.items()}
METRICS: Mapping[str, StepMetric] = {**_ERRORS, **{name: _closeness(*of) for name, of in _CLOSENESS.items()}}
