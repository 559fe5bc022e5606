"""The pose that a motion asks for, to be drawn beside the robot's own."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import Alignment, MotionReference
from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import ANCHOR_POSE, FloatArray
from humanoid_sim.policy.motion import body_poses
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import InverseKinematics
from humanoid_sim.simulation.model import joint_addresses


class ReferenceGhost:
    """A motion as poses of the robot: its joints where it names them, inverse kinematics where it has bodies alone."""

    frame: int | None = None
    """Frame of the motion in the latest policy step; None where no policy with a motion drives the robot."""
    alignment: Alignment | None = None  # where the motion is laid onto the robot; None where that is not known

    def __init__(self, description: RobotDescription, contract: PolicyContract, reference: MotionReference) -> None:
        self._contract, self._reference, self._joints = contract, reference, description.joint_names
        self._order = joint_indices(contract.joint_names, self._joints, "joint_names of the policy")
        self._has_joints, self._has_anchor = (name in reference.terms for name in ("reference_joint_pos", "anchor_pos"))
        self._kinematics: InverseKinematics | None = None
        if not self._has_joints and "motion_body_pos_b" in reference.terms:
            self._kinematics = InverseKinematics(description, contract.body_names)

    def update(self, record: TickRecord) -> None:
        """Take in a tick; the motion is laid onto the robot in that of the first frame."""
        step = record.output.policy_step
        if step is not None and (self._has_joints or self._kinematics is not None):
            self.frame = step.frame
            anchor = record.input.state.extern.get(ANCHOR_POSE)
            if step.frame == 0 and anchor is not None and self._has_anchor and self._contract.align_reference:
                self.alignment = self._reference.align(anchor.value)
        elif record.output.control_mode.mode is not Mode.LOCOMOTION:
            self.frame = self.alignment = None

    def pose(
        self, model: mujoco.MjModel, qpos: FloatArray, frame: int, alignment: Alignment | None = None
    ) -> FloatArray:
        """Return the ghost at a frame, shape (nq,): what the motion does not say is the robot's own pose, `qpos`."""
        ghost, reference = qpos.copy(), self._reference
        addresses = joint_addresses(model, self._joints).qpos
        if self._has_joints:
            ghost[addresses[self._order]] = reference.term("reference_joint_pos", frame)
        elif self._kinematics is not None:
            terms = [reference.term(name, frame) for name in ("motion_body_pos_b", "motion_body_ori_b")]
            rows = np.concatenate(terms)[None].astype(np.float64)
            position, rotation = body_poses(rows, len(self._contract.body_names))
            own = qpos[addresses]
            ghost[addresses] = self._kinematics.solve(position[0], rotation[0], own, posture=own)
        is_placed = alignment is not None or not self._contract.align_reference
        if self._has_anchor and is_placed and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
            data = mujoco.MjData(model)
            data.qpos[:] = ghost
            data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
            mujoco.mj_kinematics(model, data)
            anchor = data.body(self._contract.anchor_body)
            place, quaternion = reference.anchor(frame, alignment)
            ghost[3:7] = multiply(quaternion, conjugate(anchor.xquat))
            ghost[:3] = place - rotate(ghost[3:7], anchor.xpos)
        return ghost
