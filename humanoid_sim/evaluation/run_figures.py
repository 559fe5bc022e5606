"""Figures of a run, accumulated tick by tick: motion errors, the base's motion, use of the joints.

An error of frame k is the pose read in the very tick in which the policy was shown frame k, minus frame k. The last
frame counts once: what a policy does while it is held is not an error of the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from humanoid_sim.controllers.reference import Alignment
from humanoid_sim.controllers.rotation import quaternion_from_matrix
from humanoid_sim.evaluation.errors import rms
from humanoid_sim.evaluation.failure import describe_fall, has_fallen
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.mit import ANCHOR_POSE, FloatArray, MITState
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.kinematics import ForwardKinematics

_SETTLING = 2.0
"""s after release that means and the largest tilt leave out: the robot starts from rest, and sags as it is let go."""
_AT_LIMIT = 1.0 - 1e-9  # share of an effort limit from which on a torque is at it
_OF_BODIES = "body_position_error", "body_orientation_error", "hand_position_error", "hand_orientation_error"
_OF_ANCHOR = "joint_error", "anchor_position_error", "anchor_orientation_error"


class MotionErrors:
    """Rows of `step_metrics` over a run: of a motion of bodies in the base frame, or of joints and an anchor body."""

    def __init__(self, description: RobotDescription, loaded: LoadedPolicy) -> None:
        """Prepare. Raises `InputError` if the robot lacks a body of the motion."""
        self._context = StepContext(description, loaded.contract, loaded.reference)
        bodies = self._context.tracked
        self._kinematics = ForwardKinematics(description, bodies) if bodies else None
        self._names = _OF_BODIES if bodies else _OF_ANCHOR
        self._samples: list[FloatArray] = []
        self._is_last_shown = False
        self._alignment: Alignment | None = None

    @classmethod
    def of(cls, description: RobotDescription, loaded: LoadedPolicy) -> Self | None:
        """Return the errors of a policy that follows a motion of bodies or of an anchor body; else None."""
        terms = loaded.reference.terms
        return cls(description, loaded) if "motion_body_pos_b" in terms or "anchor_pos" in terms else None

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of a policy step with the frame that it was shown."""
        last = self._context.reference.frame_count - 1
        was_shown, self._is_last_shown = self._is_last_shown, frame >= last > 0
        sample = None if was_shown and self._is_last_shown else self._sample(frame, state)
        if sample is not None:
            self._samples.append(np.array([METRICS[name].values(self._context, sample) for name in self._names]))

    def _sample(self, frame: int, state: MITState) -> StepSample | None:
        """Return the step; None while nobody knows how the motion was laid onto the robot."""
        if self._kinematics is not None:
            position, rotation = self._kinematics(state.joint_position)
            return StepSample(state, frame, body_position=position, body_quaternion=quaternion_from_matrix(rotation))
        if ANCHOR_POSE not in state.extern:
            return None
        if self._context.contract.align_reference:
            if frame == 0:
                self._alignment = self._context.reference.align(state.extern[ANCHOR_POSE].value)
            if self._alignment is None:
                return None
        return StepSample(state, frame, alignment=self._alignment)

    def summary(self) -> dict[str, Any] | None:
        """Return the errors so far, JSON: by row unit, mean, rms and max; None if nothing was compared."""
        if not self._samples:
            return None
        errors = {}
        for name, values in zip(self._names, np.array(self._samples).T, strict=True):
            figures = {"mean": values.mean(), "rms": rms(values), "max": values.max()}
            errors[name] = {"unit": METRICS[name].unit, **{key: float(value) for key, value in figures.items()}}
        return {"samples": len(self._samples), "errors": errors}


@dataclass(slots=True)
class BaseMotion:
    """Motion of a floating base from its release on; landed once its centre of mass is as low as it stands."""

    released: float | None = None  # s, robot's clock, at which the base was let go; None while it never was
    standing_height: float = 0.0  # m, of the centre of mass, as of `has_fallen`
    last: float = 0.0  # s, robot's clock
    lowest: float = math.inf  # share of its standing height that the centre of mass had at least
    tilt_max: float | None = None  # rad, from 2 s after release on
    fall: float | None = None  # s after release at which the robot fell; None if it did not
    fell: str = ""
    height: tuple[float, float, float, int] = (math.inf, 0.0, -math.inf, 0)
    """m, of the base's origin above the floor from landing on: least, sum, greatest, count."""
    _has_landed: bool = False
    _speed: tuple[FloatArray, int] = field(default_factory=lambda: (np.zeros(3), 0))

    def release(self, time: float, standing_height: float) -> None:
        """Begin once the base is let go; `time` in s, robot's clock."""
        self.released, self.standing_height = time, standing_height

    def update(self, time: float, base: BaseState) -> str:
        """Take one tick with a free base; returns how the robot fell in the tick in which it does, else ''."""
        assert self.released is not None
        if self.fall is not None:
            return ""
        self.last, since = time, time - self.released
        height, mass_height = float(base.height), float(base.mass_height)
        if not self._has_landed:
            self._has_landed = since >= _SETTLING or mass_height <= self.standing_height
            self.height = (math.inf, 0.0, -math.inf, 0)
        low, total, high, count = self.height
        self.height = (min(low, height), total + height, max(high, height), count + 1)
        self.lowest = min(self.lowest, mass_height / self.standing_height)
        if since >= _SETTLING:
            self.tilt_max = max(self.tilt_max or 0.0, float(base.tilt))
        if has_fallen(base, self.standing_height):
            self.fall, self.fell = since, describe_fall(base, self.standing_height)
            return self.fell
        if since >= _SETTLING:
            self._speed = self._speed[0] + base.planar_velocity, self._speed[1] + 1
        return ""

    def summary(self) -> dict[str, Any] | None:
        """Return the figures, JSON; speeds are means from 2 s after release. None if the base was never free."""
        low, total, high, count = self.height
        if self.released is None or not count:
            return None
        forward, left, turning = (self._speed[0] / self._speed[1]).tolist() if self._speed[1] else (None,) * 3
        return {
            "released": self.released,
            "duration": self.last - self.released,
            "velocity": None if forward is None else (forward, left),
            "yaw_rate": turning,
            "height": (low, total / count, high),
            "lowest": self.lowest,
            "tilt_max": self.tilt_max,
            "fall": self.fall,
            "fell": self.fell,
        }


class JointUse:
    """Greatest speed and effort of each joint, and the positions it reached, without values that are no numbers."""

    def __init__(self, names: Sequence[str], effort_limit: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        """Start empty, for n joints; limits are (n,), N·m and rad, infinite where there is none."""
        n = len(names)
        self._names, self._limit, self._lower, self._upper = tuple(names), np.asarray(effort_limit), lower, upper
        self._effort, self._speed = np.zeros(n), np.zeros(n)
        self._lowest, self._highest = np.full(n, np.inf), np.full(n, -np.inf)
        self.saturated = 0
        """States in which a joint was at its effort limit."""

    def update(self, state: MITState) -> None:
        """Take one state into account."""
        effort = np.abs(state.joint_effort)
        np.fmax(self._effort, effort, out=self._effort)
        np.fmax(self._speed, np.abs(state.joint_velocity), out=self._speed)
        np.fmin(self._lowest, state.joint_position, out=self._lowest)
        np.fmax(self._highest, state.joint_position, out=self._highest)
        self.saturated += bool((effort >= self._limit * _AT_LIMIT).any())

    def effort(self) -> dict[str, Any]:
        """Return N·m, JSON: the joint closest to its limit (without any limit, the greatest), and those without one."""
        known = np.isfinite(self._limit)
        share = np.where(known, self._effort / self._limit, -1.0) if known.any() else self._effort
        i = int(share.argmax())
        return {
            "largest": float(self._effort.max()),
            "joint": self._names[i],
            "effort": float(self._effort[i]),
            "limit": _finite(self._limit[i]),
            "without_limit": [name for name, is_known in zip(self._names, known, strict=True) if not is_known],
            "saturated_ticks": self.saturated,
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return joint by joint, JSON: rad/s, N·m, rad; None where unknown."""
        columns = {
            "speed": self._speed,
            "effort": self._effort,
            "effort_limit": self._limit,
            "lowest": self._lowest,
            "highest": self._highest,
            "lower": self._lower,
            "upper": self._upper,
        }
        return [
            {"joint": name, **{column: _finite(values[i]) for column, values in columns.items()}}
            for i, name in enumerate(self._names)
        ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def describe_effort(figures: dict[str, Any]) -> str:
    """Return `JointUse.effort` in a line: `37.1 of 88 N·m at left_knee_joint, 0 ticks at an effort limit`."""
    text, missing = f"{figures['effort']:.1f} N·m at {figures['joint']}", len(figures["without_limit"])
    if figures["limit"] is not None:
        of = f"{figures['effort']:.1f} of {figures['limit']:g} N·m at {figures['joint']}"
        text = f"{of}, {figures['saturated_ticks']} ticks at an effort limit"
    if missing:
        text += f"; NO EFFORT LIMIT KNOWN for {missing} joints (give effort_limit in the contract)"
    return text
