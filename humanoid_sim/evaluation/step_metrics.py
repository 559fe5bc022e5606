"""Figures of one policy step, in one table: rewards, `regress` and `doctor` choose rows by name.

A row is a function of a `StepContext` c and a `StepSample` s, of one robot or a batch: one value for each, shape (...).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.failure import (
    body_has_strayed,
    describe_body_stray,
    describe_fall,
    describe_stray,
    has_fallen,
    has_strayed,
    length,
    quaternion_angle,
    rms,
    total,
)
from humanoid_sim.evaluation.piano_score import step_ratios
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.mit import ANCHOR_POSE, KEY_PRESSED, BoolArray, FloatArray
from humanoid_sim.simulation.floating_base import BaseState

Values = Callable[[StepContext, StepSample], FloatArray]
Needs = Literal[
    "", "motion", "motion of bodies", "motion with joints", "motion with an anchor", "floating base", "song"
]


@dataclass(frozen=True, slots=True)
class StepMetric:
    """A figure of a policy step."""

    unit: str
    formula: str
    better: Literal["lower", "higher"]
    values: Values
    needs: Needs  # part of robot, contract or motion without which it means nothing


METRICS: dict[str, StepMetric] = {}


def metric(
    unit: str, formula: str, needs: Needs = "", better: Literal["lower", "higher"] = "lower"
) -> Callable[[Values], Values]:
    """Add the function to the table under its own name."""

    def add(values: Values) -> Values:
        METRICS[values.__name__] = StepMetric(unit, formula, better, values, needs)
        return values

    return add


def _squares(values: npt.NDArray[np.floating]) -> FloatArray:
    return np.asarray(np.vecdot(values, values, dtype=np.float64))


# ---- motions


def body_distance(c: StepContext, s: StepSample) -> FloatArray:
    """Shape (..., b), m, of the tracked bodies from the motion, base frame."""
    return length(s.body_position - c.body_target[0][c.reference.clamp(s.frame)])


def body_angle(c: StepContext, s: StepSample) -> FloatArray:
    """Shape (..., b), rad, between the tracked bodies and the motion."""
    return quaternion_angle(s.body_quaternion, c.body_target[1][c.reference.clamp(s.frame)])


def anchor_poses(c: StepContext, s: StepSample) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the anchor body's pose (..., 7), and the position and quaternion of the motion laid onto the robot."""
    return s.state.extern[ANCHOR_POSE].value, *c.reference.anchor(s.frame, s.alignment)


@metric("m", "distance of the anchor from the motion", "motion with an anchor")
def anchor_position_error(c: StepContext, s: StepSample) -> FloatArray:
    pose, position, _ = anchor_poses(c, s)
    return length(position - pose[..., :3])


@metric("rad", "angle between the anchor and the motion", "motion with an anchor")
def anchor_orientation_error(c: StepContext, s: StepSample) -> FloatArray:
    pose, _, quaternion = anchor_poses(c, s)
    return quaternion_angle(pose[..., 3:], quaternion)


@metric("m", "rms distance from the motion of its tracked bodies (base frame), else of its anchor (world)", "motion")
def body_position_error(c: StepContext, s: StepSample) -> FloatArray:
    return rms(body_distance(c, s)) if c.tracked else anchor_position_error(c, s)


@metric("rad", "rms angle to the motion of its tracked bodies, else of its anchor", "motion")
def body_orientation_error(c: StepContext, s: StepSample) -> FloatArray:
    return rms(body_angle(c, s)) if c.tracked else anchor_orientation_error(c, s)


@metric("m", "rms distance from the motion of those tracked bodies that are hands", "motion of bodies")
def hand_position_error(c: StepContext, s: StepSample) -> FloatArray:
    return rms(body_distance(c, s)[..., c.hands])


@metric("rad", "rms angle to the motion of those tracked bodies that are hands", "motion of bodies")
def hand_orientation_error(c: StepContext, s: StepSample) -> FloatArray:
    return rms(body_angle(c, s)[..., c.hands])


@metric("rad", "rms(q - q_motion)", "motion with joints")
def joint_error(c: StepContext, s: StepSample) -> FloatArray:
    assert c.joint_target is not None
    return rms(s.state.joint_position - c.joint_target[np.minimum(s.frame, len(c.joint_target) - 1)])


@metric("1", "1 where a tracked body is > 0.3 m off, or the anchor > 0.35 m in height or > 1.2 rad in tilt", "motion")
def strayed(c: StepContext, s: StepSample) -> FloatArray:
    is_lost = body_has_strayed(body_distance(c, s)) if c.tracked else has_strayed(*anchor_poses(c, s))
    return is_lost.astype(np.float64)


# ---- floating bases


def _base(s: StepSample) -> BaseState:
    assert s.base is not None
    return s.base


@metric("1", "1 where it has fallen: centre of mass < 0.6 of its standing height, or tilt > 1 rad", "floating base")
def fallen(c: StepContext, s: StepSample) -> FloatArray:
    return has_fallen(_base(s), c.standing_height).astype(np.float64)


@metric("m/s", "|v - v_command|, horizontal, heading frame", "floating base")
def velocity_error(c: StepContext, s: StepSample) -> FloatArray:
    return length(_base(s).planar_velocity[..., :2] - s.command[..., :2])


@metric("rad/s", "|yaw rate - its command|", "floating base")
def yaw_rate_error(c: StepContext, s: StepSample) -> FloatArray:
    return np.abs(_base(s).planar_velocity[..., 2] - s.command[..., 2])


@metric("rad", "angle between the axis that points up where it stands and the vertical", "floating base")
def tilt(c: StepContext, s: StepSample) -> FloatArray:
    return _base(s).tilt


@metric("1", "squared sine of the angle between the base's z axis and the vertical", "floating base")
def lean(c: StepContext, s: StepSample) -> FloatArray:
    return _squares(_base(s).gravity[..., :2])


@metric("m²/s²", "squared vertical velocity of the base", "floating base")
def vertical_velocity(c: StepContext, s: StepSample) -> FloatArray:
    return np.asarray(_base(s).linear_velocity[..., 2] ** 2)


@metric("rad²/s²", "squared angular velocity of the base about its x and y axes", "floating base")
def rocking(c: StepContext, s: StepSample) -> FloatArray:
    return _squares(_base(s).angular_velocity[..., :2])


# ---- joints


@metric("1", "1", better="higher")
def alive(c: StepContext, s: StepSample) -> FloatArray:
    return np.ones(s.torque.shape[:-1])


@metric("N·m", "rms torque over the joints")
def effort(c: StepContext, s: StepSample) -> FloatArray:
    return rms(s.torque)


@metric("W", "sum of |torque · joint velocity|")
def power(c: StepContext, s: StepSample) -> FloatArray:
    return total(np.abs(s.torque * s.state.joint_velocity))


@metric("1", "sum of (torque / effort limit)²")
def effort_share(c: StepContext, s: StepSample) -> FloatArray:
    return _squares(s.torque * c.inverse_effort)


@metric("action²", "sum of the squared change of the raw action")
def action_change(c: StepContext, s: StepSample) -> FloatArray:
    return _squares(s.action - s.previous_action)


@metric("rad", "sum of how far joints are beyond their limits less 0.05 rad")
def joint_stops(c: StepContext, s: StepSample) -> FloatArray:
    q = s.state.joint_position
    return total(np.maximum(np.maximum(c.lowest - q, q - c.highest), 0.0))


@metric("rad²/s²", "sum of squared joint velocities")
def joint_speed(c: StepContext, s: StepSample) -> FloatArray:
    return _squares(s.state.joint_velocity)


# ---- pianos; the first two are the key press reward of RoboPianist (Zakka et al. 2023)


def pressed_and_wanted(c: StepContext, s: StepSample) -> tuple[BoolArray, BoolArray]:
    """Return which keys are down and which should be, shape (..., 88)."""
    return np.asarray(s.state.extern[KEY_PRESSED].value > 0.5), c.song[c.reference.clamp(s.frame)]


@metric("1", "1 where no other key is down", "song", "higher")
def no_wrong_key(c: StepContext, s: StepSample) -> FloatArray:
    pressed, wanted = pressed_and_wanted(c, s)
    return np.where((pressed & ~wanted).any(axis=-1), 0.0, 1.0)


def _ratio(name: str, formula: str, which: int) -> None:
    def values(c: StepContext, s: StepSample) -> FloatArray:
        return step_ratios(*pressed_and_wanted(c, s))[which]

    METRICS[name] = StepMetric("share", formula, "higher", values, "song")


_ratio("precision", "of the keys that are down, those that should be", 0)
_ratio("recall", "of the keys that should be down, those that are; 1 where there are none", 1)
_ratio("f1", "harmonic mean of precision and recall", 2)


def _closeness(name: str, of: str, scale: float) -> None:
    error = METRICS[of]

    def values(c: StepContext, s: StepSample) -> FloatArray:
        return np.asarray(np.exp(-np.square(error.values(c, s) / scale)))

    METRICS[name] = StepMetric("1", f"exp(-({of} / {scale:g} {error.unit})²)", "higher", values, error.needs)


_closeness("body_position", "body_position_error", 0.1)
_closeness("body_orientation", "body_orientation_error", 0.4)
_closeness("joint_position", "joint_error", 0.3)
_closeness("anchor_position", "anchor_position_error", 0.3)
_closeness("anchor_orientation", "anchor_orientation_error", 0.4)
_closeness("linear_velocity", "velocity_error", 0.25)
_closeness("yaw_rate", "yaw_rate_error", 0.5)


def describe_failure(c: StepContext, s: StepSample, i: int | tuple[()] = ()) -> str:
    """Return why robot `i` of a batch, () for the only one, has fallen or strayed."""
    if s.base is not None and np.asarray(has_fallen(s.base, c.standing_height))[i]:
        return describe_fall(s.base, c.standing_height, i)
    if c.tracked:
        return describe_body_stray(body_distance(c, s)[i], c.tracked)
    return describe_stray(*(part[i] for part in anchor_poses(c, s)))
