"""The metrics of each task: what they mean, and how the steps of an episode make one number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.results import MetricInfo

__all__ = ["ALWAYS", "METRICS", "Metric", "Summary", "TaskName", "summarise"]

TaskName = Literal["tracking", "velocity"]
Summary = Literal["rms", "mean", "episode"]
"""How an episode's steps become its value: root mean square, mean, or not at all: it is of the episode as a whole."""


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric."""

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
_VELOCITY = (
    _metric("velocity_error", "m/s", "mean", "Horizontal velocity over the last second against the command."),
    _metric("yaw_rate_error", "rad/s", "mean", "Rate about the vertical over the last second against the command."),
    _metric("tilt", "rad", "rms", "Angle between the base's z axis and the vertical."),
    _metric("slip", "m/s", "mean", "Speed along the ground of the feet's points that touch it."),
    _metric("power", "W", "mean", "Mechanical power of all joints, taken as positive where they brake, too."),
    *_CARE,
    _metric("falls", "share", "episode", "Episodes that ended because the robot fell."),
    *_END,
)
METRICS: Mapping[TaskName, Mapping[str, Metric]] = MappingProxyType(
    {
        "tracking": MappingProxyType({metric.info.name: metric for metric in _TRACKING}),
        "velocity": MappingProxyType({metric.info.name: metric for metric in _VELOCITY}),
    }
)
"""By task and name, in the order in which they are shown."""


ALWAYS: Mapping[TaskName, tuple[str, ...]] = MappingProxyType(
    {"tracking": ("losses", "faults"), "velocity": ("falls", "faults")}
)
"""What is judged whether a suite names it or not: errors are those of the episodes that did not fail."""


def summarise(summary: Summary, values: FloatArray) -> float | None:
    """One number of the values of an episode's steps, shape (K,); steps that are not a number do not count."""
    known = values[~np.isnan(values)]
    if not known.size:
        return None
    result = float(np.sqrt((known * known).mean())) if summary == "rms" else float(known.mean())
    return result if np.isfinite(result) else None
