"""Follow a motion: with bodies in the robot's base frame (the Lite's arms), or with joints and a body in the world."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Frame
from humanoid_sim.controllers.rotation import quaternion_from_matrix, rotation_from_6d
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.evaluation.errors import PoseError, pose_error, quaternion_angle, total
from humanoid_sim.evaluation.failure import body_has_strayed, describe_body_stray, describe_stray, has_strayed
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import ANCHOR_POSE, FloatArray
from humanoid_sim.robots.schema import RobotDescription

_POSITION_SCALE = 0.1
"""m, of bodies in the base frame."""
_ANCHOR_SCALE = 0.3
"""m, of the anchor body in the world."""
_ORIENTATION_SCALE = 0.4
"""rad"""
_JOINT_SCALE = 0.3
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

    def _prepare(self, description: RobotDescription) -> None:
        count, terms = len(self.contract.body_names), self.reference.terms
        self._position = terms["motion_body_pos_b"].astype(np.float64).reshape(-1, count, 3)
        columns = terms["motion_body_ori_b"].astype(np.float64).reshape(-1, count, 6)
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
        return values, body_has_strayed(np.sqrt(squared))

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        distance = self.position_error(sample.body_position, sample.frame)[i]
        return describe_body_stray(distance, self.contract.body_names)


class MotionTask(Task):
    """Follow the motion's joints, and its anchor body as far as the motion has one, to the end of the motion.

    ================== ====== ==== ==================================================================================
    term               weight unit value
    ================== ====== ==== ==================================================================================
    joint_position     1.0    1    exp(-e²/0.3² rad²), e² the squared joint position error in rad², mean over joints
    anchor_position    0.5    1    exp(-e²/0.3² m²), e the distance of the anchor body from its reference, m
    anchor_orientation 0.5    1    exp(-θ²/0.4² rad²), θ the angle between the anchor body and its reference
    ================== ====== ==== ==================================================================================

    Terminated where the anchor body is 0.35 m above or below its reference or tilted against it by 1.2 rad, and as
    every floating base where it falls; truncated with the motion's last frame. Without an anchor body the
    two anchor terms are 0.
    """

    FOLLOWS_MOTION = True
    REFERENCE = "reference_joint_pos"
    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType(
        {"joint_position": 1.0, "anchor_position": 0.5, "anchor_orientation": 0.5, **Task.WEIGHTS}
    )

    def _prepare(self, description: RobotDescription) -> None:
        contract = self.contract
        self._order = joint_indices(contract.joint_names, description.joint_names, "joint_names of the policy")
        self.has_anchor = "anchor_pos" in self.reference.terms and bool(contract.anchor_body)
        """True where motion and contract say where a body is in the world."""

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        target = self.reference.term("reference_joint_pos", sample.frame)
        error = sample.state.joint_position[..., self._order] - target
        values = {"joint_position": np.exp((error * error).mean(axis=-1) / -(_JOINT_SCALE**2))}
        nothing = np.zeros_like(values["joint_position"])
        if not self.has_anchor:
            return values | {"anchor_position": nothing, "anchor_orientation": nothing}, nothing != 0.0
        posed = self.anchor_error(sample)
        angle = posed.angle
        values["anchor_position"] = np.exp(total(posed.offset * posed.offset) / -(_ANCHOR_SCALE**2))
        values["anchor_orientation"] = np.exp(angle * angle / -(_ORIENTATION_SCALE**2))
        return values, has_strayed(posed)

    def anchor_error(self, sample: StepSample) -> PoseError:
        """Return the anchor body's error against the reference as it was laid onto the robot."""
        return pose_error(
            sample.state.extern[ANCHOR_POSE].value, *self.reference.anchor(sample.frame, sample.alignment)
        )

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        return describe_stray(self.anchor_error(sample), i)
