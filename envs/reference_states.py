"""The states of a robot that follows its motion exactly, frame by frame: where an episode in its middle begins."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rotation import multiply, rotate
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray, IndexArray
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.stance import clearance


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceStates:
    """One state for each frame of a reference."""

    joint_position: FloatArray
    """Shape (F, n), rad, robot's order, within the joints' limits."""
    joint_velocity: FloatArray
    """Shape (F, n), rad/s."""
    base_pose: FloatArray | None
    """Shape (F, 7), m and w x y z, world frame, of a floating base whose place the motion tells; None without one."""
    base_velocity: FloatArray | None
    """Shape (F, 6), m/s, world frame, and rad/s, base frame."""

    def base_at(self, frame: IndexArray, yaw: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Pose (..., 7) and velocity (..., 6) of the base at frames (...), the motion turned by `yaw`, (...), rad.

        It is turned about the world's vertical through the origin.
        """
        if self.base_pose is None or self.base_velocity is None:
            return None
        none = np.zeros_like(yaw)
        turn = np.stack([np.cos(0.5 * yaw), none, none, np.sin(0.5 * yaw)], axis=-1)
        pose, velocity = self.base_pose[frame], self.base_velocity[frame]
        return (
            np.concatenate([rotate(turn, pose[..., :3]), multiply(turn, pose[..., 3:])], axis=-1),
            np.concatenate([rotate(turn, velocity[..., :3]), velocity[..., 3:]], axis=-1),
        )


def reference_states(
    description: RobotDescription, contract: PolicyContract, reference: MotionReference
) -> ReferenceStates | None:
    """Return the states of all frames, with the velocities from frame to frame; None where the motion tells no joints.

    Where a motion has the robot below its floor, the base is lifted onto it. Raises `InputError` if the MJCF has other
    bodies that move before the floating base.
    """
    if "reference_joint_pos" not in reference.terms:
        return None
    order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
    joints = reference.terms["reference_joint_pos"][:, order].astype(np.float64)
    model = build_model(description, scene="floor")
    addresses = joint_addresses(model, description.joint_names)
    qpos = np.tile(model.qpos0, (len(joints), 1))
    qpos[:, addresses.qpos] = np.clip(joints, description.lower, description.upper)
    has_base = description.is_floating and "anchor_pos" in reference.terms
    ghost = ReferenceGhost.of(description, contract, reference)
    if has_base and ghost is not None:
        place, orientation, _, _ = base_addresses(model, description)
        if place.start:
            raise InputError(
                f"reference_start: the base '{description.base.body}' of '{description.name}' is not the first body "
                f"that moves in {description.mjcf_path}"
            )
        for frame, row in enumerate(qpos):
            posed = ghost.pose(model, row, frame)
            row[place], row[orientation] = posed[place], posed[orientation]
            row[place][2] += description.simulation.floor_height
            row[place][2] += max(0.0, -clearance(model, row))
    qvel = np.zeros((len(qpos), model.nv))
    for frame, row in enumerate(qvel):
        before, after = max(frame - 1, reference.first(frame)), min(frame + 1, reference.last(frame))
        if after > before:
            seconds = float(after - before) * contract.policy_dt
            mujoco.mj_differentiatePos(model, row, seconds, qpos[before], qpos[after])
    base_pose = base_velocity = None
    if has_base:
        place, orientation, linear, angular = base_addresses(model, description)
        base_pose = np.concatenate([qpos[:, place], qpos[:, orientation]], axis=1)
        base_velocity = np.concatenate([qvel[:, linear], qvel[:, angular]], axis=1)
    return ReferenceStates(qpos[:, addresses.qpos], qvel[:, addresses.dof], base_pose, base_velocity)
