"""The motion reference of a policy: tables indexed by an integer frame, loaded whole before activation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.rotation import conjugate, multiply, rotate, yaw_quaternion
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import Float32Array, FloatArray

Frame = int | npt.NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """A rotation about the vertical and a shift along the ground, from the motion's world to the robot's."""

    yaw: FloatArray  # shape (..., 4), w x y z
    offset: FloatArray  # shape (..., 3), m


@dataclass(frozen=True, slots=True, eq=False)
class MotionReference:
    """Reference terms by name, one row per policy step."""

    frame_count: int
    terms: Mapping[str, Float32Array]
    """Each of shape (frame_count, width), in the term's own unit. Beside terms that observations name:
    `reference_joint_pos`, `reference_joint_vel` (n, policy order, rad and rad/s) and `anchor_pos` (3), `anchor_quat`
    (4, w x y z) of the anchor body in the motion's world."""

    def __post_init__(self) -> None:
        terms = {name: np.array(table, dtype=np.float32) for name, table in self.terms.items()}
        for table in terms.values():
            table.setflags(write=False)
        object.__setattr__(self, "terms", terms)

    def following(self, frame: Frame) -> Frame:
        """Return the next frame, or the last one again."""
        return self.clamp(frame + 1)

    def clamp(self, frame: Frame) -> Frame:
        """Return the frame itself, or the last one from the end of the motion on: there it is held."""
        last = self.frame_count - 1
        return min(frame, last) if isinstance(frame, int) else np.minimum(frame, last)

    def term(self, name: str, frame: Frame) -> Float32Array:
        """Return the row of a term, shape (..., width) for frames of shape (...)."""
        return np.asarray(self.terms[name][self.clamp(frame)])

    def progress(self, frame: Frame) -> FloatArray:
        """Return frame over last frame, [0, 1]; 1 for a motion of one frame."""
        last = self.frame_count - 1
        return np.asarray(np.divide(self.clamp(frame), last) if last else np.ones(np.shape(frame)))

    def anchor(self, frame: Frame, alignment: Alignment | None) -> tuple[FloatArray, FloatArray]:
        """Return where the anchor body should be: position (..., 3), m, and quaternion (..., 4), world frame."""
        position = self.term("anchor_pos", frame).astype(np.float64)
        quaternion = self.term("anchor_quat", frame).astype(np.float64)
        if alignment is None:
            return position, quaternion
        return rotate(alignment.yaw, position) + alignment.offset, multiply(alignment.yaw, quaternion)

    def align(self, pose: FloatArray) -> Alignment:
        """Align the first frame with an anchor body's pose, shape (..., 7), in heading and place but not in height."""
        position, quaternion = self.anchor(0, None)
        yaw = yaw_quaternion(multiply(pose[..., 3:], conjugate(quaternion)))
        offset = pose[..., :3] - rotate(yaw, position)
        return Alignment(yaw, offset * np.array([1.0, 1.0, 0.0]))


def no_reference() -> MotionReference:
    """Return the reference of a policy that follows none."""
    return MotionReference(1, {})


def build_reference(contract: PolicyContract, frames: npt.ArrayLike) -> MotionReference:
    """Cut the frames of a motion file, shape (f, width), into the terms of the contract's task.

    Tracking of b bodies: `[positions 3 b | orientations 6 b]`, m and rotation-matrix entries, base frame. Piano: key
    states, 0 or 1. Raises `FieldError` if the width does not fit the task.
    """
    table = np.asarray(frames, dtype=np.float32)
    if contract.task_type == "tracking":
        bodies = len(contract.body_names)
        if table.shape[1] != 9 * bodies:
            raise FieldError(f"motion: frames are {table.shape[1]} wide, expected 9 for each of {bodies} bodies")
        terms = {"motion_body_pos_b": table[:, : 3 * bodies], "motion_body_ori_b": table[:, 3 * bodies :]}
        return MotionReference(len(table), terms)
    steps = np.arange(len(table))[:, None] + np.asarray(contract.lookahead_steps, dtype=np.intp)
    future = table[np.minimum(steps, len(table) - 1)].reshape(len(table), -1)
    return MotionReference(len(table), {"target_keys": table, "target_keys_future": future})


def build_world_reference(
    contract: PolicyContract, frames: npt.ArrayLike, joint_names: tuple[str, ...], body_names: tuple[str, ...]
) -> MotionReference:
    """Cut frames of n joints and world poses of b bodies into the terms that anchor policies compare with.

    Frames are `[joint positions n | joint velocities n | positions 3 b | quaternions 4 b]`, rad, rad/s and m, w x y z,
    world frame. Without the contract's anchor body among the bodies, its terms are left out. Raises `FieldError` if a
    joint of the policy is missing.
    """
    table = np.asarray(frames, dtype=np.float32)
    n, b = len(joint_names), len(body_names)
    order = joint_indices(contract.joint_names, joint_names, "joints of the motion")
    terms = {"reference_joint_pos": table[:, order], "reference_joint_vel": table[:, n + order]}
    if contract.anchor_body in body_names:
        i = body_names.index(contract.anchor_body)
        position, quaternion = 2 * n + 3 * i, 2 * n + 3 * b + 4 * i
        terms["anchor_pos"] = table[:, position : position + 3]
        terms["anchor_quat"] = table[:, quaternion : quaternion + 4]
    return MotionReference(len(table), terms)
