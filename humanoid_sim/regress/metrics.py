"""Metrics of each task. A new one is a row here, and its values in `humanoid_sim.regress.measures`."""

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
    better: Literal["lower", "higher"] = "lower"


_ALL = (
    Metric("effort", "N·m", "rms"),  # joint torque, over joints and steps
    Metric("action_rate", "rad/s", "rms"),  # change of the commanded positions from step to step
    Metric("faults", "share", "episode"),  # the controller refused an observation or action, or physics diverged
    Metric("survival", "share", "episode", "higher"),  # part of the planned episode that was reached
)
_TRACKING = (
    Metric("body_position_error", "m", "rms"),  # of the tracked bodies against the motion's
    Metric("body_orientation_error", "rad", "rms"),
    Metric("joint_error", "rad", "rms"),  # against the motion's joints; of bodies, by inverse kinematics
    Metric("losses", "share", "episode"),  # the robot strayed too far from the motion
    *_ALL,
)
REACHED = ("vx_reached", "vy_reached", "yaw_rate_reached")
_VELOCITY = (
    Metric("velocity_error", "m/s", "mean"),  # horizontal velocity over the last second against the command
    Metric("yaw_rate_error", "rad/s", "mean"),
    # mean speed over the commanded along each axis, at most 1; where it is to move
    *(Metric(name, "×", "episode", "higher") for name in REACHED),
    Metric("tilt", "rad", "rms"),  # between the base's z axis and the vertical
    Metric("slip", "m/s", "mean"),  # of the feet's points that touch the ground
    Metric("power", "W", "mean"),  # mechanical, of all joints, positive where they brake, too
    Metric("falls", "share", "episode"),
    *_ALL,
)
_PIANO = (
    Metric("f1", "share", "mean", "higher"),  # of the keys that are down against the song's, step by step
    Metric("precision", "share", "mean", "higher"),
    Metric("recall", "share", "mean", "higher"),
    Metric("note_f1", "share", "episode", "higher"),  # a stroke counts within 0.1 s of its note
    Metric("key_force", "N", "episode"),  # hardest touch of a key, of every physics step
    Metric("hard_touches", "share", "episode"),  # a key was touched harder than the robot allows
    *_ALL,
)
METRICS: Mapping[TaskName, Mapping[str, Metric]] = {
    "tracking": {metric.name: metric for metric in _TRACKING},
    "velocity": {metric.name: metric for metric in _VELOCITY},
    "piano": {metric.name: metric for metric in _PIANO},
}
"""By task and name."""
FAILURES: Mapping[TaskName, tuple[str, str]] = {
    "tracking": ("losses", "faults"),
    "velocity": ("falls", "faults"),
    "piano": ("hard_touches", "faults"),
}
"""Shares of episodes, judged whether a suite names them or not: errors are those of the episodes that did not fail."""

_LEAST_COMMAND = 0.1  # m/s or rad/s: a smaller command asks to stand along its axis


def has_metric(name: str, command: Sequence[float] | None) -> bool:
    """Return whether a case with this command has a metric: a speed is reached only along an axis that is to move."""
    return name not in REACHED or (command is not None and abs(command[REACHED.index(name)]) >= _LEAST_COMMAND)
