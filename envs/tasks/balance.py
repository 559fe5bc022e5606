"""Nothing in particular: stay up, and spend little on it. For contracts whose goal no other task knows."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.evaluation.errors import total
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray

__all__ = ["BalanceTask"]


class BalanceTask(Task):
    """Stay up for as long as the episode lasts.

    ============== ====== ======== ================================================================================
    term           weight unit     value
    ============== ====== ======== ================================================================================
    alive          1.0    1        1
    joint_velocity -0.001 rad²/s²  squared joint velocity, summed over the joints
    ============== ====== ======== ================================================================================

    Terminated where a floating base tilts by more than 1 rad or sinks below 0.6 of its height at the start.
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType({"alive": 1.0, "joint_velocity": -0.001, **Task.WEIGHTS})

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        velocity = sample.state.joint_velocity
        speed = total(velocity * velocity)
        return {"alive": np.ones_like(speed), "joint_velocity": speed}, np.zeros(speed.shape, dtype=np.bool_)
