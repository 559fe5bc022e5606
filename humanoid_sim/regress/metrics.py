"""Metrics of episodes. A new one is a row here, and its values in `humanoid_sim.regress.episodes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from humanoid_sim.evaluation.step_metrics import METRICS

TaskName = Literal["tracking", "velocity", "piano"]


class Metric(NamedTuple):
    """A figure of an episode."""

    name: str
    unit: str
    summary: Literal["rms", "mean", "episode"]
    """Summary of the policy steps: root mean square, mean, or none, for a figure of the episode as a whole."""
    task: TaskName | None = None
    better: Literal["lower", "higher"] = "lower"


def _of_steps(name: str, summary: Literal["rms", "mean"], task: TaskName | None = None) -> Metric:
    row = METRICS[name]
    return Metric(name, row.unit, summary, task, row.better)


REACHED = ("vx_reached", "vy_reached", "yaw_rate_reached")
_METRICS = (
    _of_steps("body_position_error", "rms", "tracking"),
    _of_steps("body_orientation_error", "rms", "tracking"),
    _of_steps("joint_error", "rms", "tracking"),  # of a motion of bodies: against its joints by inverse kinematics
    Metric("losses", "share", "episode", "tracking"),  # the robot strayed too far from the motion
    Metric("velocity_error", "m/s", "mean", "velocity"),  # over the last second against the command
    Metric("yaw_rate_error", "rad/s", "mean", "velocity"),
    # mean speed over the commanded along each axis, at most 1; where it is to move
    *(Metric(name, "×", "episode", "velocity", "higher") for name in REACHED),
    _of_steps("tilt", "rms", "velocity"),
    Metric("slip", "m/s", "mean", "velocity"),  # of the feet's points that touch the ground
    _of_steps("power", "mean", "velocity"),
    Metric("falls", "share", "episode", "velocity"),
    _of_steps("f1", "mean", "piano"),
    _of_steps("precision", "mean", "piano"),
    _of_steps("recall", "mean", "piano"),
    Metric("key_force", "N", "episode", "piano"),  # hardest touch of a key, of every physics step
    Metric("hard_touches", "share", "episode", "piano"),  # a key was touched harder than the robot allows
    _of_steps("effort", "rms"),
    Metric("action_rate", "rad/s", "rms"),  # change of the commanded positions from step to step
    Metric("faults", "share", "episode"),  # the controller refused an observation or action, or physics diverged
    Metric("survival", "share", "episode", None, "higher"),  # part of the planned episode that was reached
)
_FAILURES = ("losses", "falls", "hard_touches", "faults")


def metrics_of(task: TaskName) -> Mapping[str, Metric]:
    """Return the metrics of a task by name."""
    return {metric.name: metric for metric in _METRICS if metric.task in (None, task)}


def failures_of(task: TaskName) -> tuple[str, ...]:
    """Return the shares of episodes that are always judged: errors are those of the episodes that did not fail."""
    return tuple(name for name in _FAILURES if name in metrics_of(task))


def has_metric(name: str, command: Sequence[float] | None) -> bool:
    """Return whether a case with this command has a metric: a speed is reached only along an axis that is to move."""
    least = 0.1  # m/s or rad/s: a smaller command asks to stand along its axis
    return name not in REACHED or (command is not None and abs(command[REACHED.index(name)]) >= least)
