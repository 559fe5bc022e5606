"""One body of a chain: how its pose follows from its parent's and from its joints."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.rows import column, multiply, normalize, rotate

__all__ = ["BALL", "FREE", "SLIDE", "Body", "BodyPose", "Joint", "place", "read_body", "turn"]

FREE, BALL, SLIDE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_SLIDE


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The origin and the axes of a body, N environments."""

    position: FloatArray
    """Shape (3, N) or (3, 1), m, world frame."""
    quaternion: FloatArray
    """Shape (4, N) or (4, 1), w x y z, body frame in the world frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One joint of a body."""

    kind: mujoco.mjtJoint
    qpos: int
    dof: int
    axis: FloatArray
    """Shape (3, 1), body frame."""
    anchor: FloatArray
    """Shape (3, 1), m, body frame."""
    is_centred: bool
    """The anchor is the body's origin."""
    zero: float
    """Position at which the body is as the MJCF draws it."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body that can move, and its joints in their order."""

    parent: int
    position: FloatArray
    """Shape (3, 1), m, parent frame."""
    quaternion: FloatArray
    """Shape (4, 1), parent frame."""
    joints: tuple[Joint, ...]


def read_body(model: mujoco.MjModel, i: int) -> Body:
    """Body `i` of a model, not one that is welded to the world."""
    first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
    joints = tuple(_joint(model, j) for j in range(first, first + count))
    return Body(int(model.body_parentid[i]), column(model.body_pos[i]), column(model.body_quat[i]), joints)


def _joint(model: mujoco.MjModel, j: int) -> Joint:
    qpos = int(model.jnt_qposadr[j])
    return Joint(
        kind=mujoco.mjtJoint(int(model.jnt_type[j])),
        qpos=qpos,
        dof=int(model.jnt_dofadr[j]),
        axis=column(model.jnt_axis[j]),
        anchor=column(model.jnt_pos[j]),
        is_centred=not np.any(model.jnt_pos[j]),
        zero=float(model.qpos0[qpos]),
    )


def place(body: Body, parent: BodyPose, qpos: FloatArray) -> BodyPose:
    """The pose of a body whose parent's is known; `qpos` is (nq, N)."""
    if body.joints and body.joints[0].kind == FREE:
        start = body.joints[0].qpos
        return BodyPose(qpos[start : start + 3], normalize(qpos[start + 3 : start + 7]))
    position = parent.position + rotate(parent.quaternion, body.position)
    quaternion = multiply(parent.quaternion, body.quaternion)
    for joint in body.joints:
        if joint.kind == SLIDE:
            position = position + rotate(quaternion, joint.axis) * (qpos[joint.qpos] - joint.zero)
            continue
        turned = multiply(quaternion, turn(joint, qpos))
        if not joint.is_centred:
            position = position + rotate(quaternion, joint.anchor) - rotate(turned, joint.anchor)
        quaternion = turned
    return BodyPose(position, normalize(quaternion) if body.joints else quaternion)


def turn(joint: Joint, qpos: FloatArray) -> FloatArray:
    """The rotation that a hinge or a ball joint makes, shape (4, N)."""
    if joint.kind == BALL:
        return normalize(qpos[joint.qpos : joint.qpos + 4])
    half = 0.5 * (qpos[joint.qpos] - joint.zero)
    rotation = np.empty((4, half.shape[0]))
    rotation[0] = np.cos(half)
    rotation[1:] = joint.axis * np.sin(half)
    return rotation
