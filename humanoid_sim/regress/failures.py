"""Why an episode failed, in one line."""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.envs.tasks.sample import StepSample
from humanoid_sim.envs.tasks.tracking import TrackingTask
from humanoid_sim.regress.arena import Arena

__all__ = ["loss_in_words"]

_UPSIDE = math.radians(45.0)
"""rad of tilt from which on a robot that fell is said to have tilted over."""


def loss_in_words(arena: Arena, sample: StepSample, i: int) -> str:
    """How robot i of a batch was lost."""
    task = arena.task
    if isinstance(task, TrackingTask):
        error = task.position_error(sample.body_position, sample.frame)[i]
        body = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        return f"strayed: {arena.setting.contract.body_names[body]} is {error[body]:.2f} m from the motion"
    if sample.base is None:
        return "strayed from the motion"
    tilt, height = float(sample.base.tilt[i]), float(sample.base.height[i])
    if tilt > _UPSIDE:
        return f"fell: tilted by {math.degrees(tilt):.0f}°"
    if arena.motion is not None:
        return f"strayed from the motion: base at {height:.2f} m, tilted by {math.degrees(tilt):.0f}°"
    return f"fell: sank to {height:.2f} m"
