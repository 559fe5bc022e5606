"""Follow a motion that is given as joint positions, with the pose of one body in the world: whole-body tracking."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.evaluation.errors import PoseError, pose_error, total
from humanoid_sim.evaluation.failure import describe_stray, has_strayed
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import ANCHOR_POSE, FloatArray
from humanoid_sim.robots.schema import RobotDescription

_JOINT_SCALE = 0.3
"""rad"""
_POSITION_SCALE = 0.3
"""m"""
_ORIENTATION_SCALE = 0.4
"""rad"""


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

    def __init__(
        self, description: RobotDescription, contract: PolicyContract, reference: MotionReference, **options: Any
    ) -> None:
        """As `Task`, with a reference that has `reference_joint_pos`."""
        super().__init__(description, contract, reference, **options)
        self._order = joint_indices(contract.joint_names, description.joint_names, "joint_names of the policy")
        self.has_anchor = "anchor_pos" in reference.terms and bool(contract.anchor_body)
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
        values["anchor_position"] = np.exp(total(posed.offset * posed.offset) / -(_POSITION_SCALE**2))
        values["anchor_orientation"] = np.exp(angle * angle / -(_ORIENTATION_SCALE**2))
        return values, has_strayed(posed)

    def anchor_error(self, sample: StepSample) -> PoseError:
        """Return the anchor body's error against the reference as it was laid onto the robot."""
        return pose_error(
            sample.state.extern[ANCHOR_POSE].value, *self.reference.anchor(sample.frame, sample.alignment)
        )

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        return describe_stray(self.anchor_error(sample), i)
