"""How well a whole-body tracking policy follows its reference: joints, and the pose of the anchor body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.context import ANCHOR_POSE
from humanoid_sim.controllers.joint_order import joint_indices
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.mit import MITState

__all__ = ["AnchorErrors", "AnchorSummary"]


@dataclass(frozen=True, slots=True)
class AnchorSummary:
    """Errors over the policy steps of a run; of each, the mean and the greatest."""

    samples: int
    joint_error: tuple[float, float]
    """rad, of the mean over the joints."""
    anchor_position: tuple[float, float]
    """m"""
    anchor_angle: tuple[float, float]
    """rad"""


class AnchorErrors:
    """Accumulates errors against the reference, laid onto the robot as the policy's own was at activation."""

    def __init__(
        self, reference: MotionReference, joint_names: tuple[str, ...], robot_joints: tuple[str, ...], *, align: bool
    ) -> None:
        """Look the joints up.

        Args:
            reference: with joint positions and anchor poses.
            joint_names: of the policy.
            robot_joints: order of the state's per-joint arrays.
            align: whether the policy's reference is laid onto the robot.
        """
        self._reference = reference
        self._order = joint_indices(joint_names, robot_joints, "joint_names of the policy")
        self._align = align
        self._alignment: Alignment | None = None
        self._sum = np.zeros(3)
        self._largest = np.zeros(3)
        self._samples = 0

    def update(self, frame: int, state: MITState) -> None:
        """Compare the state of a policy step with the frame that it was shown."""
        live = state.extern.get(ANCHOR_POSE)
        if live is None:
            return
        pose = live.value
        if frame == 0 and self._align:
            self._alignment = self._reference.align(pose)
        position, quaternion = self._reference.anchor(frame, self._alignment)
        joints = self._reference.term("reference_joint_pos", frame)
        between = multiply(conjugate(pose[3:]), quaternion)
        error = np.array(
            [
                np.abs(state.joint_position[self._order] - joints).mean(),
                np.sqrt(((position - pose[:3]) ** 2).sum()),
                2.0 * np.arctan2(np.sqrt((between[1:] ** 2).sum()), abs(between[0])),
            ]
        )
        self._sum += error
        np.maximum(self._largest, error, out=self._largest)
        self._samples += 1

    def summary(self) -> AnchorSummary | None:
        """The errors so far; None if nothing was compared."""
        if not self._samples:
            return None
        joint, position, angle = (
            (float(mean), float(most)) for mean, most in zip(self._sum / self._samples, self._largest, strict=True)
        )
        return AnchorSummary(self._samples, joint, position, angle)
