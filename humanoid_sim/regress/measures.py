"""Measures every policy step of a batch of episodes, and makes metrics and traces of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from humanoid_sim.envs.tasks.motion import MotionTask
from humanoid_sim.envs.tasks.tracking import TrackingTask
from humanoid_sim.evaluation.errors import length, rms
from humanoid_sim.evaluation.sample import StepSample
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.regress.arena import Arena
from humanoid_sim.regress.feet import Feet

__all__ = ["Measures", "TrackingMeasures", "VelocityMeasures", "WorldPoses"]

_WINDOW = 1.0
"""s over which a walking robot's velocity is averaged: one or two strides, so that their sway does not count."""


WorldPoses = tuple[FloatArray, FloatArray]
"""Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z, of bodies in the world frame."""


class Measures(Protocol):
    """Collects a batch of episodes of one case, N of them."""

    def add(self, step: int, sample: StepSample, command: MITCommand, poses: WorldPoses) -> None:
        """Take one policy step.

        Args:
            step: from 0.
            sample: after the step, without the sensors' noise.
            command: that was in force.
            poses: of the feet after the step; none for a robot whose feet do not matter.
        """
        ...

    def traces(self) -> Mapping[str, FloatArray]:
        """By name, shape (steps, N); NaN where there is nothing to measure."""
        ...


class _Table:
    """Named values, one per step and episode."""

    def __init__(self, names: tuple[str, ...], steps: int, count: int) -> None:
        self.rows = {name: np.full((steps, count), np.nan) for name in names}

    def __setitem__(self, key: tuple[str, int], value: FloatArray) -> None:
        name, step = key
        self.rows[name][step] = value


class _Care:
    """What every task measures: torque, and how the commanded positions change."""

    NAMES = ("effort", "action_rate")

    def __init__(self, period: float) -> None:
        self._period = period
        self._last: FloatArray | None = None

    def add(self, table: _Table, step: int, sample: StepSample, command: MITCommand) -> None:
        table["effort", step] = rms(sample.torque)
        if self._last is not None:
            table["action_rate", step] = rms((command.position - self._last) / self._period)
        self._last = command.position


class TrackingMeasures:
    """Errors against a motion: of bodies in the base's frame, or of joints and an anchor body in the world."""

    def __init__(self, arena: Arena, count: int) -> None:
        """Prepare for `count` episodes."""
        names = ("body_position_error", "body_orientation_error", "joint_error", *_Care.NAMES)
        self._table = _Table(names, arena.steps, count)
        self._arena = arena
        self._care = _Care(arena.policy_dt)

    def add(self, step: int, sample: StepSample, command: MITCommand, poses: WorldPoses) -> None:
        """See `Measures.add`."""
        del poses  # the tracked bodies are in the sample
        arena, table = self._arena, self._table
        task = arena.task
        if isinstance(task, TrackingTask):
            table["body_position_error", step] = rms(task.position_error(sample.body_position, sample.frame))
            table["body_orientation_error", step] = rms(task.orientation_error(sample.body_quaternion, sample.frame))
        elif isinstance(task, MotionTask) and task.has_anchor:
            error = task.anchor_error(sample)
            table["body_position_error", step] = error.distance
            table["body_orientation_error", step] = error.angle
        if arena.joint_reference is not None:
            target = arena.joint_reference[arena.reference.clamp(sample.frame)]
            table["joint_error", step] = rms(sample.state.joint_position - target)
        self._care.add(table, step, sample, command)

    def traces(self) -> Mapping[str, FloatArray]:
        """See `Measures.traces`."""
        return self._table.rows


class VelocityMeasures:
    """How well a robot keeps a commanded velocity, how upright, and at what cost."""

    def __init__(self, arena: Arena, count: int, feet: Feet, settle: float) -> None:
        """Prepare for `count` episodes whose first `settle` s do not count for the errors."""
        self._feet = feet
        self._period = arena.policy_dt
        self._skip = round(settle / self._period)
        self._velocity = np.full((arena.steps, count, 3), np.nan)
        self._command = np.zeros((count, 3))
        self._table = _Table(("tilt", "slip", "power", *_Care.NAMES), arena.steps, count)
        self._care = _Care(self._period)
        self._points: FloatArray | None = None

    def add(self, step: int, sample: StepSample, command: MITCommand, poses: WorldPoses) -> None:
        """See `Measures.add`."""
        base, table = sample.base, self._table
        assert base is not None  # a velocity suite refuses robots with a fixed base
        self._command = sample.command
        self._velocity[step] = base.planar_velocity
        table["tilt", step] = base.tilt
        points = self._feet.place(*poses)
        if self._points is not None:
            table["slip", step] = self._feet.slip(self._points, points, self._period)
        self._points = points
        table["power", step] = np.abs(sample.torque * sample.state.joint_velocity).sum(axis=-1)
        self._care.add(table, step, sample, command)

    def traces(self) -> Mapping[str, FloatArray]:
        """See `Measures.traces`."""
        error = _trailing_mean(self._velocity, round(_WINDOW / self._period)) - self._command
        error[: self._skip] = np.nan
        return {
            "velocity_error": length(error[..., :2]),
            "yaw_rate_error": np.abs(error[..., 2]),
            **self._table.rows,
        }


def _trailing_mean(values: FloatArray, window: int) -> FloatArray:
    """The mean of the last `window` steps, of fewer at the beginning; shape (steps, ...)."""
    total = np.cumsum(values, axis=0)
    total[window:] -= total[:-window].copy()
    steps = np.minimum(np.arange(1, len(values) + 1), window)
    mean: FloatArray = total / steps.reshape(-1, *[1] * (values.ndim - 1))
    return mean
