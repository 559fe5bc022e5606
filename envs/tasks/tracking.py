"""Follow a motion that is given as poses of bodies in the robot's base frame: the Lite's arms."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.reference import Frame, MotionReference
from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.evaluation.errors import quaternion_angle, total
from humanoid_sim.evaluation.failure import body_has_strayed, describe_body_stray
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

_POSITION_SCALE = 0.1
"""m"""
_ORIENTATION_SCALE = 0.4
"""rad"""


class TrackingTask(Task):
    """Bring the contract's bodies to where the motion has them, frame by frame, to the end of the motion.

    ================ ====== ==== ==================================================================================
    term             weight unit value
    ================ ====== ==== ==================================================================================
    body_position    1.0    1    exp(-e²/0.1² m²), e² the squared position error in m², mean over the bodies
    body_orientation 0.5    1    exp(-θ²/0.4² rad²), θ² the squared angle of the orientation error, mean over them
    ================ ====== ==== ==================================================================================

    Terminated where a body is further than 0.3 m from its reference; truncated with the motion's last frame.
    """

    FOLLOWS_MOTION = True
    REFERENCE = "motion_body_pos_b"
    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {"body_position": 1.0, "body_orientation": 0.5, **Task.WEIGHTS}
    )

    def __init__(
        self, description: RobotDescription, contract: PolicyContract, reference: MotionReference, **options: Any
    ) -> None:
        """As `Task`, with a reference that has `motion_body_pos_b` and `motion_body_ori_b`."""
        super().__init__(description, contract, reference, **options)
        count = len(contract.body_names)
        self._position = reference.terms["motion_body_pos_b"].astype(np.float64).reshape(-1, count, 3)
        columns = reference.terms["motion_body_ori_b"].astype(np.float64).reshape(-1, count, 6)
        self._quaternion = quaternion_from_matrix(rotation_from_6d(columns))

    def position_error(self, body_position: FloatArray, frame: Frame) -> FloatArray:
        """Shape (..., b), m, of body positions (..., b, 3) against a frame (...)."""
        error: FloatArray = np.sqrt(self._squared_distance(body_position, frame))
        return error

    def _squared_distance(self, body_position: FloatArray, frame: Frame) -> FloatArray:
        offset = body_position - self._position[self.reference.clamp(frame)]
        return total(offset * offset)

    def orientation_error(self, body_quaternion: FloatArray, frame: Frame) -> FloatArray:
        """Shape (..., b), rad in [0, π], of body orientations (..., b, 4) against a frame (...)."""
        return quaternion_angle(body_quaternion, self._quaternion[self.reference.clamp(frame)])

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        squared = self._squared_distance(sample.body_position, sample.frame)
        angle = self.orientation_error(sample.body_quaternion, sample.frame)
        count = squared.shape[-1]
        values = {
            "body_position": np.exp(total(squared) / (-count * _POSITION_SCALE**2)),
            "body_orientation": np.exp(total(angle * angle) / (-count * _ORIENTATION_SCALE**2)),
        }
        return values, body_has_strayed(squared)

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        distance = self.position_error(sample.body_position, sample.frame)[i]
        return describe_body_stray(distance, self.contract.body_names)
