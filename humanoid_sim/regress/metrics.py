"""Metrics of episodes. A new one is a row here, and its values in `humanoid_sim.regress.episodes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

TaskName = Literal["tracking", "velocity", "piano"]


class Metric(NamedTuple):
    """A figure of an episode."""

    name: str
    unit: str
    """Such as `m`; `share` for a share, between 0 and 1."""
    summary: Literal["rms", "mean", "episode"]
    """Summary of the policy steps: root mean square, mean, or none, for a figure of the episode as a whole."""
    task: TaskName | None = None
    """Task that has it; None: all."""
    better: Literal["lower", "higher"] = "lower"


REACHED = ("vx_reached", "vy_reached", "yaw_rate_reached")
_METRICS = (
    Metric("body_position_error", "m", "rms", "tracking"),  # of the tracked bodies against the motion's
    Metric("body_orientation_error", "rad", "rms", "tracking"),
    Metric("joint_error", "rad", "rms", "tracking"),  # against the motion's joints; of bodies, by inverse kinematics
    Metric("losses", "share", "episode", "tracking"),  # the robot strayed too far from the motion
    Metric("velocity_error", "m/s", "mean", "velocity"),  # over the last second against the command
    Metric("yaw_rate_error", "rad/s", "mean", "velocity"),
    # mean speed over the commanded along each axis, at most 1; where it is to move
    *(Metric(name, "×", "episode", "velocity", "higher") for name in REACHED),
    Metric("tilt", "rad", "rms", "velocity"),  # between the base's z axis and the vertical
    Metric("slip", "m/s", "mean", "velocity"),  # of the feet's points that touch the ground
    Metric("power", "W", "mean", "velocity"),  # mechanical, of all joints, positive where they brake, too
    Metric("falls", "share", "episode", "velocity"),
    Metric("f1", "share", "mean", "piano", "higher"),  # of the keys that are down against the song's, step by step
    Metric("precision", "share", "mean", "piano", "higher"),
    Metric("recall", "share", "mean", "piano", "higher"),
    Metric("note_f1", "share", "episode", "piano", "higher"),  # a stroke counts within 0.1 s of its note
    Metric("key_force", "N", "episode", "piano"),  # hardest touch of a key, of every physics step
    Metric("hard_touches", "share", "episode", "piano"),  # a key was touched harder than the robot allows
    Metric("effort", "N·m", "rms"),  # joint torque, over joints and steps
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
