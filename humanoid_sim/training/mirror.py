"""The right arm as the mirror image of the left: one network, and one set of training data, serve both.

The reflection S = diag(1, -1, 1) through the robot's middle plane takes a left body's pose (p, R) to its right
counterpart's (S p, S R D). D = diag(±1) belongs to the body: which of its own axes is reflected depends on how the
frames of the two sides were laid.
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.mit import FloatArray

__all__ = ["ARM_BODIES", "ARM_JOINTS", "JOINT_SIGN", "ORIENTATION_SIGN", "POSITION_SIGN", "arm_joints", "both_arms"]

ARM_BODIES = ("elbow_pitch", "hand")
"""Tracked bodies of one arm, without the side."""

ARM_JOINTS = 7

JOINT_SIGN = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Shape (7,): the right arm's joint positions in the mirrored pose, divided by the left arm's."""

POSITION_SIGN = np.array([1.0, -1.0, 1.0])
"""Shape (3,): the diagonal of S."""

_BODY_AXES = np.array([[1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]])
"""Shape (2, 3): the diagonals of D, elbow and hand."""

ORIENTATION_SIGN = POSITION_SIGN[None, :, None] * _BODY_AXES[:, None, :2]
"""Shape (2, 3, 2): what S R D does to the first two columns of the two bodies' rotation matrices."""


def both_arms(left: FloatArray, right: FloatArray) -> FloatArray:
    """Joint positions (..., 14) of the robot from those of two left arms (..., 7), the second one mirrored."""
    return np.concatenate([left, right * JOINT_SIGN], axis=-1)


def arm_joints(joints: FloatArray) -> FloatArray:
    """The inverse of `both_arms`: (..., 14) to (..., 2, 7), both as left arms."""
    arms = joints.reshape(*joints.shape[:-1], 2, ARM_JOINTS)
    left: FloatArray = arms * np.stack([np.ones(ARM_JOINTS), JOINT_SIGN])
    return left
