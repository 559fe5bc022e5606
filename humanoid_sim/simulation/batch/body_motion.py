"""How a body of a chain moves: velocity and acceleration from its parent's and from its joints'."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.body_links import BALL, FREE, SLIDE, Body, BodyPose, place, turn
from humanoid_sim.simulation.batch.rows import cross, multiply, rotate

__all__ = ["BodyMotion", "move", "rest"]


@dataclass(frozen=True, slots=True, eq=False)
class BodyMotion:
    """How a body moves, N environments; all in the world frame."""

    pose: BodyPose
    angular_velocity: FloatArray
    """Shape (3, N), rad/s."""
    angular_acceleration: FloatArray
    """Shape (3, N), rad/s²."""
    linear_acceleration: FloatArray
    """Shape (3, N), m/s², of the origin, gravity not included."""


def rest(pose: BodyPose) -> BodyMotion:
    """The motion of what does not move."""
    none = np.zeros((3, 1))
    return BodyMotion(pose, none, none, none)


def move(body: Body, parent: BodyMotion, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> BodyMotion:
    """The motion of a body whose parent's is known; the arrays are (nq, N) and (nv, N)."""
    pose = place(body, parent.pose, qpos)
    if body.joints and body.joints[0].kind == FREE:
        # The linear part is the origin's in the world frame, the angular part is in the body frame.
        dof = body.joints[0].dof
        spin = rotate(pose.quaternion, qvel[dof + 3 : dof + 6])
        return BodyMotion(pose, spin, rotate(pose.quaternion, qacc[dof + 3 : dof + 6]), qacc[dof : dof + 3])
    position = parent.pose.position + rotate(parent.pose.quaternion, body.position)
    quaternion = multiply(parent.pose.quaternion, body.quaternion)
    spin, spin_up = parent.angular_velocity, parent.angular_acceleration
    acceleration = parent.linear_acceleration + _carried(spin, spin_up, position - parent.pose.position)
    for joint in body.joints:
        if joint.kind == SLIDE:
            axis = rotate(quaternion, joint.axis)
            shift = axis * (qpos[joint.qpos] - joint.zero)
            rate = axis * qvel[joint.dof]
            acceleration = acceleration + _carried(spin, spin_up, shift) + axis * qacc[joint.dof]
            acceleration = acceleration + 2.0 * cross(spin, rate)  # Coriolis
            position = position + shift
            continue
        turned = multiply(quaternion, turn(joint, qpos))
        if joint.kind == BALL:
            rate = rotate(turned, qvel[joint.dof : joint.dof + 3])
            rate_up = rotate(turned, qacc[joint.dof : joint.dof + 3])
        else:
            axis = rotate(quaternion, joint.axis)
            rate, rate_up = axis * qvel[joint.dof], axis * qacc[joint.dof]
        # The anchor moves with the parent's side of the joint, the origin turns about it with the child's.
        to_anchor, from_anchor = rotate(quaternion, joint.anchor), -rotate(turned, joint.anchor)
        acceleration = acceleration + _carried(spin, spin_up, to_anchor)
        spin_up = spin_up + rate_up + cross(spin, rate)
        spin = spin + rate
        acceleration = acceleration + _carried(spin, spin_up, from_anchor)
        position, quaternion = position + to_anchor + from_anchor, turned
    return BodyMotion(pose, spin, spin_up, acceleration)


def _carried(spin: FloatArray, spin_up: FloatArray, arm: FloatArray) -> FloatArray:
    """Acceleration of a point at `arm` from the origin of a rigid body, relative to the origin's."""
    return cross(spin_up, arm) + cross(spin, cross(spin, arm))
