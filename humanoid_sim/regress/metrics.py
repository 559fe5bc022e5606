"""Metrics of each task: what they mean, how every policy step is measured, and how the steps make one number.

A new metric is an entry in `METRICS` and, unless it is of the episode as a whole, a row in the measures of its task.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.tasks.task import Task
from humanoid_sim.envs.tasks.tracking import MotionTask, TrackingTask
from humanoid_sim.evaluation.errors import length, rms
from humanoid_sim.evaluation.feet import Feet
from humanoid_sim.evaluation.piano_score import score, step_ratios
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import KEY_PRESSED, FloatArray, MITCommand
from humanoid_sim.regress.results import MetricInfo
from humanoid_sim.simulation.batch import BatchSimulation

TaskName = Literal["tracking", "velocity", "piano"]
Summary = Literal["rms", "mean", "episode"]
"""Summary of an episode's steps: root mean square, mean, or none, for a value of the episode as a whole."""


class Metric(NamedTuple):
    """One metric, and the summary of its steps."""

    info: MetricInfo
    summary: Summary


def _metric(name: str, unit: str, summary: Summary, text: str, better: Literal["lower", "higher"] = "lower") -> Metric:
    return Metric(MetricInfo(name=name, unit=unit, better=better, summary=text), summary)


_CARE = (
    _metric("effort", "N·m", "rms", "Joint torque: root mean square over joints and steps."),
    _metric(
        "action_rate",
        "rad/s",
        "rms",
        "Change of the commanded positions from step to step: root mean square over joints and steps.",
    ),
)
_END = (
    _metric(
        "faults",
        "share",
        "episode",
        "Episodes that ended because the controller refused an observation or an action, or the simulation diverged.",
    ),
    _metric("survival", "share", "episode", "Part of the planned episode that was reached.", "higher"),
)
_TRACKING = (
    _metric("body_position_error", "m", "rms", "Distance of the tracked bodies from the motion's."),
    _metric("body_orientation_error", "rad", "rms", "Angle between the tracked bodies and the motion's."),
    _metric("joint_error", "rad", "rms", "Joint angles against the motion's; of bodies, by inverse kinematics."),
    *_CARE,
    _metric("losses", "share", "episode", "Episodes that ended because the robot strayed too far from the motion."),
    *_END,
)
_REACHED = {"vx_reached": "vx", "vy_reached": "vy", "yaw_rate_reached": "yaw rate"}
"""Metrics of the speed along each axis of a command, in the command's order."""
_LEAST_COMMAND = 0.1
"""m/s or rad/s below which a command asks to stand along its axis, and is too small to divide by."""
_VELOCITY = (
    _metric("velocity_error", "m/s", "mean", "Horizontal velocity over the last second against the command."),
    _metric("yaw_rate_error", "rad/s", "mean", "Rate about the vertical over the last second against the command."),
    *(
        _metric(name, "×", "episode", f"Mean {axis} over the commanded, at most 1; where it is to move.", "higher")
        for name, axis in _REACHED.items()
    ),
    _metric("tilt", "rad", "rms", "Angle between the base's z axis and the vertical."),
    _metric("slip", "m/s", "mean", "Speed along the ground of the feet's points that touch it."),
    _metric("power", "W", "mean", "Mechanical power of all joints, taken as positive where they brake, too."),
    *_CARE,
    _metric("falls", "share", "episode", "Episodes that ended because the robot fell."),
    *_END,
)
_PIANO = (
    _metric(
        "f1", "share", "mean", "F1 of the keys that are down against the song's, of each step by itself.", "higher"
    ),
    _metric("precision", "share", "mean", "Of the keys that are down, those that should be, of each step.", "higher"),
    _metric("recall", "share", "mean", "Of the keys that should be down, those that are, of each step.", "higher"),
    _metric(
        "note_f1", "share", "episode", "F1 of strokes and notes: a stroke counts within 0.1 s of its note.", "higher"
    ),
    _metric("key_force", "N", "episode", "The hardest touch of a key, of every physics step."),
    _metric("hard_touches", "share", "episode", "Episodes in which a key was touched harder than the robot allows."),
    *_CARE,
    *_END,
)
METRICS: Mapping[TaskName, Mapping[str, Metric]] = {
    "tracking": {metric.info.name: metric for metric in _TRACKING},
    "velocity": {metric.info.name: metric for metric in _VELOCITY},
    "piano": {metric.info.name: metric for metric in _PIANO},
}
"""By task and name, in the order in which they are shown."""

ALWAYS: Mapping[TaskName, tuple[str, ...]] = {
    "tracking": ("losses", "faults"),
    "velocity": ("falls", "faults"),
    "piano": ("hard_touches", "faults"),
}
"""Metrics that are judged whether a suite names them or not: errors are those of the episodes that did not fail."""

_WINDOW = 1.0
"""s over which a walking robot's velocity is averaged: one or two strides, so that their sway does not count."""


def has_metric(name: str, command: Sequence[float] | None) -> bool:
    """Tell whether a case with this command has a metric: a speed is reached only along an axis that is to move."""
    if name not in _REACHED:
        return True
    return command is not None and abs(command[[*_REACHED].index(name)]) >= _LEAST_COMMAND


def summarise(summary: Summary, values: FloatArray) -> float | None:
    """One number of the values of an episode's steps, shape (K,); steps that are not a number do not count."""
    known = values[~np.isnan(values)]
    if not known.size:
        return None
    result = float(rms(known)) if summary == "rms" else float(known.mean())
    return result if np.isfinite(result) else None


class Measures:
    """Measures every policy step of a batch of N episodes; by itself torque, and how commanded positions change."""

    def __init__(self, task: Task, steps: int, count: int, names: tuple[str, ...]) -> None:
        """Room for `steps` values of each name."""
        self.task = task
        self.period = task.contract.policy_dt
        """s"""
        self.rows = {name: np.full((steps, count), np.nan) for name in (*names, "effort", "action_rate")}
        """By name, shape (steps, N); NaN where there is nothing to measure."""
        self._last: FloatArray | None = None

    def add(self, step: int, sample: StepSample, command: MITCommand, simulation: BatchSimulation) -> None:
        """Take one policy step; the sample is what came of it, without the sensors' noise."""
        self.rows["effort"][step] = rms(sample.torque)
        if self._last is not None:
            self.rows["action_rate"][step] = rms((command.position - self._last) / self.period)
        self._last = command.position

    def step_values(self) -> Mapping[str, FloatArray]:
        """By name, shape (steps, N); NaN where there is nothing to measure."""
        return self.rows

    def of_episode(self, i: int, steps: int) -> Mapping[str, float]:
        """Return what is of episode `i` as a whole, after its `steps`, by name."""
        return {}


class TrackingMeasures(Measures):
    """Errors against a motion: of bodies in the base's frame, or of joints and an anchor body in the world."""

    def __init__(self, task: Task, joint_reference: FloatArray | None, steps: int, count: int) -> None:
        """As `Measures`; `joint_reference` is (F, n), rad, robot's order, or None where the motion names no joints."""
        super().__init__(task, steps, count, ("body_position_error", "body_orientation_error", "joint_error"))
        self._joint_reference = joint_reference

    def add(self, step: int, sample: StepSample, command: MITCommand, simulation: BatchSimulation) -> None:
        """See `Measures.add`."""
        super().add(step, sample, command, simulation)
        task, rows = self.task, self.rows
        if isinstance(task, TrackingTask):
            rows["body_position_error"][step] = rms(task.position_error(sample.body_position, sample.frame))
            rows["body_orientation_error"][step] = rms(task.orientation_error(sample.body_quaternion, sample.frame))
        elif isinstance(task, MotionTask) and task.has_anchor:
            error = task.anchor_error(sample)
            rows["body_position_error"][step] = error.distance
            rows["body_orientation_error"][step] = error.angle
        if self._joint_reference is not None:
            target = self._joint_reference[task.reference.clamp(sample.frame)]
            rows["joint_error"][step] = rms(sample.state.joint_position - target)


class VelocityMeasures(Measures):
    """Errors against a commanded velocity, tilt, slip and power."""

    def __init__(self, task: Task, feet: Feet, settle: float, steps: int, count: int) -> None:
        """As `Measures`, for episodes whose first `settle` s do not count for the errors."""
        super().__init__(task, steps, count, ("tilt", "slip", "power"))
        self._feet = feet
        self._skip = round(settle / self.period)
        self._velocity = np.full((steps, count, 3), np.nan)
        self._command = np.zeros((count, 3))
        self._points: FloatArray | None = None

    def add(self, step: int, sample: StepSample, command: MITCommand, simulation: BatchSimulation) -> None:
        """See `Measures.add`."""
        super().add(step, sample, command, simulation)
        base = sample.base
        assert base is not None  # a velocity suite refuses robots with a fixed base
        self._command = sample.command
        self._velocity[step] = base.planar_velocity
        self.rows["tilt"][step] = base.tilt
        points = self._feet.place(*simulation.body_poses())
        if self._points is not None:
            self.rows["slip"][step] = self._feet.slip(self._points, points, self.period)
        self._points = points
        self.rows["power"][step] = np.abs(sample.torque * sample.state.joint_velocity).sum(axis=-1)

    def step_values(self) -> Mapping[str, FloatArray]:
        """See `Measures.step_values`."""
        window = round(_WINDOW / self.period)
        total = np.cumsum(self._velocity, axis=0)
        total[window:] -= total[:-window].copy()
        steps = np.minimum(np.arange(1, len(total) + 1), window)
        error = total / steps.reshape(-1, 1, 1) - self._command
        error[: self._skip] = np.nan
        return {"velocity_error": length(error[..., :2]), "yaw_rate_error": np.abs(error[..., 2]), **self.rows}

    def of_episode(self, i: int, steps: int) -> Mapping[str, float]:
        """See `Measures.of_episode`."""
        if steps <= self._skip:
            return {}
        mean, command = self._velocity[self._skip : steps, i].mean(axis=0), self._command[i].tolist()
        return {
            name: min(float(mean[axis] / command[axis]), 1.0)
            for axis, name in enumerate(_REACHED)
            if has_metric(name, command)
        }


class PianoMeasures(Measures):
    """Keys that are down against those that the song asks for, and how hard they are touched."""

    def __init__(self, task: Task, goals: npt.NDArray[np.floating], force_limit: float, steps: int, count: int) -> None:
        """As `Measures`, for goals of shape (F, 88), and keys that may be touched with `force_limit` N."""
        super().__init__(task, steps, count, ("f1", "precision", "recall", "key_force"))
        self._force_limit = force_limit
        self._goals = goals > 0.5
        self._down = np.zeros((steps, count, goals.shape[1]), dtype=np.bool_)
        self._wanted = np.zeros_like(self._down)

    def add(self, step: int, sample: StepSample, command: MITCommand, simulation: BatchSimulation) -> None:
        """See `Measures.add`."""
        super().add(step, sample, command, simulation)
        self._down[step] = sample.state.extern[KEY_PRESSED].value > 0.5
        self._wanted[step] = self._goals[np.minimum(sample.frame, len(self._goals) - 1)]
        ratios = step_ratios(self._down[step], self._wanted[step])
        for name, values in zip(("precision", "recall", "f1"), ratios, strict=True):
            self.rows[name][step] = values
        self.rows["key_force"][step] = simulation.key_force

    def of_episode(self, i: int, steps: int) -> Mapping[str, float]:
        """See `Measures.of_episode`."""
        if not steps:
            return {}
        force = float(self.rows["key_force"][:steps, i].max())
        return {
            "note_f1": score(self._down[:steps, i], self._wanted[:steps, i], self.period).notes.f1,
            "key_force": force,
            "hard_touches": float(force > self._force_limit),
        }
