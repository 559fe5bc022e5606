"""The pose that a motion asks for, to be drawn beside the robot's own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import ANCHOR_POSE, FloatArray, MITCommand
from humanoid_sim.policy.motion import body_poses
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import InverseKinematics
from humanoid_sim.simulation.model import JointAddresses, joint_addresses


def commanded_pose(command: MITCommand, qpos: FloatArray, addresses: JointAddresses) -> FloatArray | None:
    """Return `qpos`, shape (nq,), with the joints that have a stiffness where they are commanded; None without any.

    The command's n joints have these addresses.
    """
    pulled = (command.stiffness > 0.0) & np.isfinite(command.position)
    if not pulled.any():
        return None
    pose = qpos.copy()
    pose[addresses.qpos[pulled]] = command.position[pulled]
    return pose


class ShownReference:
    """Frame of its motion that a run's policy is shown, and where the motion is laid onto the robot, tick by tick."""

    frame: int | None = None
    """Frame of the latest policy step; None where the policy does not drive the robot."""
    anchor: FloatArray | None = None
    """Shape (7,), m and w x y z, world frame: the anchor body's pose at frame 0, where the motion begins."""

    def look(self, record: TickRecord) -> None:
        """Take a tick."""
        step = record.output.policy_step
        if step is not None:
            live = record.input.state.extern.get(ANCHOR_POSE) if step.frame == 0 else None
            self.frame, self.anchor = step.frame, self.anchor if live is None else live.value
        elif record.output.control_mode.mode is not Mode.LOCOMOTION:
            self.frame = self.anchor = None


@dataclass(slots=True, eq=False)
class ReferenceGhost:
    """A motion as poses of the robot: its joints where it names them, inverse kinematics where it has bodies alone."""

    description: RobotDescription
    joint_names: tuple[str, ...]  # of the policy
    body_names: tuple[str, ...]  # that the motion moves
    anchor_body: str
    is_aligned: bool  # True if the motion is laid onto the robot
    reference: MotionReference
    _kinematics: InverseKinematics | None = field(default=None, init=False)
    _last: tuple[int, FloatArray] | None = field(default=None, init=False)  # frame and its joints
    _alignment: Alignment | None = field(default=None, init=False)

    @classmethod
    def of(cls, description: RobotDescription, contract: PolicyContract, reference: MotionReference) -> Self | None:
        """Return the ghost of a policy's motion; None where the reference holds no poses."""
        if {"reference_joint_pos", "motion_body_pos_b"} & reference.terms.keys():
            joints, bodies = contract.joint_names, contract.body_names
            return cls(description, joints, bodies, contract.anchor_body, contract.align_reference, reference)
        return None

    def align(self, anchor_pose: FloatArray) -> None:
        """Lay the motion onto the robot: its anchor body's pose (7,), m and w x y z, world frame, at frame 0."""
        if self.is_aligned and "anchor_pos" in self.reference.terms:
            self._alignment = self.reference.align(anchor_pose)

    @property
    def has_place(self) -> bool:
        """True if it is known where a base that moves freely should be."""
        return not self.is_aligned or "anchor_pos" not in self.reference.terms or self._alignment is not None

    def pose(self, model: mujoco.MjModel, qpos: FloatArray, frame: int) -> FloatArray:
        """Return the ghost at a frame, shape (nq,): what the motion does not say is the robot's own pose, `qpos`."""
        ghost = qpos.copy()
        addresses = joint_addresses(model, self.description.joint_names).qpos
        ghost[addresses] = self._joints(qpos[addresses], frame)
        if "anchor_pos" in self.reference.terms and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            data = mujoco.MjData(model)
            data.qpos[:] = ghost
            data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
            mujoco.mj_kinematics(model, data)
            anchor = data.body(self.anchor_body)
            position, quaternion = self.reference.anchor(frame, self._alignment)
            ghost[3:7] = multiply(quaternion, conjugate(anchor.xquat))
            ghost[:3] = position - rotate(ghost[3:7], anchor.xpos)
        return ghost

    def _joints(self, present: FloatArray, frame: int) -> FloatArray:
        """Shape (n,), rad, the robot's order."""
        if "reference_joint_pos" in self.reference.terms:
            joints = present.copy()
            order = joint_indices(self.joint_names, self.description.joint_names, "joint_names of the policy")
            joints[order] = self.reference.term("reference_joint_pos", frame)
            return joints
        if self._last is None or self._last[0] != frame:
            self._kinematics = self._kinematics or InverseKinematics(self.description, self.body_names)
            terms = [self.reference.term(name, frame) for name in ("motion_body_pos_b", "motion_body_ori_b")]
            frames = np.concatenate(terms)[None].astype(np.float64)
            position, rotation = body_poses(frames, len(self.body_names))
            start = present if self._last is None else self._last[1]
            self._last = frame, self._kinematics.solve(position[0], rotation[0], start, posture=present)
        return self._last[1]
