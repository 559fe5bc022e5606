"""Where bodies are in every environment of a batch: MuJoCo's forward kinematics as array arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.envs.batch.rows import column, cross, multiply, normalize, rotate
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray

__all__ = ["BodyMotion", "BodyPose", "BodyTree", "body_ids"]


@dataclass(frozen=True, slots=True, eq=False)
class BodyPose:
    """The origin and the axes of a body, N environments."""

    position: FloatArray
    """Shape (3, N) or (3, 1), m, world frame."""
    quaternion: FloatArray
    """Shape (4, N) or (4, 1), w x y z, body frame in the world frame."""


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


_FREE, _BALL, _SLIDE, _HINGE = (
    mujoco.mjtJoint.mjJNT_FREE,
    mujoco.mjtJoint.mjJNT_BALL,
    mujoco.mjtJoint.mjJNT_SLIDE,
    mujoco.mjtJoint.mjJNT_HINGE,
)


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
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
class _Body:
    parent: int
    position: FloatArray
    """Shape (3, 1), m, parent frame."""
    quaternion: FloatArray
    """Shape (4, 1), parent frame."""
    joints: tuple[_Joint, ...]


def body_ids(model: mujoco.MjModel, names: Sequence[str]) -> tuple[int, ...]:
    """Ids of bodies by name.

    Raises:
        InputError: a name is not a body of the model; the message lists those that are.
    """
    known = [model.body(i).name for i in range(1, model.nbody)]
    for name in names:
        if name not in known:
            raise InputError(known_names("body", name, known))
    return tuple(int(model.body(name).id) for name in names)


class BodyTree:
    """The chains of bodies that lead to the ones asked for.

    The arithmetic is that of `mj_kinematics`, so the signs of the quaternions are its signs too. Only what does not
    move is taken from the model once; masses may differ between environments, lengths may not.
    """

    def __init__(self, model: mujoco.MjModel, bodies: Sequence[int]) -> None:
        """Find the chains.

        Args:
            model: any one of the batch.
            bodies: ids of the bodies whose poses will be asked for.
        """
        self.bodies = tuple(int(body) for body in bodies)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        # What is welded to the world, the world itself included, is where it is.
        self._still = {
            int(i): BodyPose(column(data.xpos[i]), column(data.xquat[i]))
            for i in np.flatnonzero(np.asarray(model.body_weldid) == 0)
        }
        needed: set[int] = set()
        for body in self.bodies:
            link = body
            while link not in self._still and link not in needed:
                needed.add(link)
                link = int(model.body_parentid[link])
        self._moving = {i: _body(model, i) for i in sorted(needed)}  # parents have the lower ids

    def poses(self, qpos: FloatArray) -> dict[int, BodyPose]:
        """Pose of every body on the chains, by id.

        Args:
            qpos: shape (N, nq), MuJoCo's generalised position.
        """
        found = dict(self._still)
        columns = np.ascontiguousarray(qpos.T)
        for i, body in self._moving.items():
            found[i] = _place(body, found[body.parent], columns)
        return found

    def arrays(self, qpos: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z, of the bodies asked for, world frame."""
        poses = self.poses(qpos)
        position = np.empty((len(qpos), len(self.bodies), 3))
        quaternion = np.empty((len(qpos), len(self.bodies), 4))
        for b, body in enumerate(self.bodies):
            position[:, b] = poses[body].position.T
            quaternion[:, b] = poses[body].quaternion.T
        return position, quaternion

    def motion(self, body: int, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> BodyMotion:
        """Pose, velocity and acceleration of one body on the chains.

        Args:
            body: its id.
            qpos: shape (N, nq).
            qvel: shape (N, nv).
            qacc: shape (N, nv).
        """
        if body in self._still:
            none = np.zeros((3, 1))
            return BodyMotion(self._still[body], none, none, none)
        own = self._moving[body]
        parent = self.motion(own.parent, qpos, qvel, qacc)
        return _move(own, parent, qpos.T, qvel.T, qacc.T)


def _body(model: mujoco.MjModel, i: int) -> _Body:
    first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
    joints = tuple(_joint(model, j) for j in range(first, first + count))
    return _Body(int(model.body_parentid[i]), column(model.body_pos[i]), column(model.body_quat[i]), joints)


def _joint(model: mujoco.MjModel, j: int) -> _Joint:
    qpos = int(model.jnt_qposadr[j])
    return _Joint(
        kind=mujoco.mjtJoint(int(model.jnt_type[j])),
        qpos=qpos,
        dof=int(model.jnt_dofadr[j]),
        axis=column(model.jnt_axis[j]),
        anchor=column(model.jnt_pos[j]),
        is_centred=not np.any(model.jnt_pos[j]),
        zero=float(model.qpos0[qpos]),
    )


def _place(body: _Body, parent: BodyPose, qpos: FloatArray) -> BodyPose:
    """The pose of a body whose parent's is known; `qpos` is (nq, N)."""
    if body.joints and body.joints[0].kind == _FREE:
        start = body.joints[0].qpos
        return BodyPose(qpos[start : start + 3], normalize(qpos[start + 3 : start + 7]))
    position = parent.position + rotate(parent.quaternion, body.position)
    quaternion = multiply(parent.quaternion, body.quaternion)
    for joint in body.joints:
        if joint.kind == _SLIDE:
            position = position + rotate(quaternion, joint.axis) * (qpos[joint.qpos] - joint.zero)
            continue
        turned = multiply(quaternion, _turn(joint, qpos))
        if not joint.is_centred:
            position = position + rotate(quaternion, joint.anchor) - rotate(turned, joint.anchor)
        quaternion = turned
    return BodyPose(position, normalize(quaternion) if body.joints else quaternion)


def _turn(joint: _Joint, qpos: FloatArray) -> FloatArray:
    """The rotation that a hinge or a ball joint makes, shape (4, N)."""
    if joint.kind == _BALL:
        return normalize(qpos[joint.qpos : joint.qpos + 4])
    half = 0.5 * (qpos[joint.qpos] - joint.zero)
    turn = np.empty((4, half.shape[0]))
    turn[0] = np.cos(half)
    turn[1:] = joint.axis * np.sin(half)
    return turn


def _move(body: _Body, parent: BodyMotion, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> BodyMotion:
    """The motion of a body whose parent's is known; the arrays are (nq, N) and (nv, N)."""
    pose = _place(body, parent.pose, qpos)
    if body.joints and body.joints[0].kind == _FREE:
        # The linear part is the origin's in the world frame, the angular part is in the body frame.
        dof = body.joints[0].dof
        spin = rotate(pose.quaternion, qvel[dof + 3 : dof + 6])
        return BodyMotion(pose, spin, rotate(pose.quaternion, qacc[dof + 3 : dof + 6]), qacc[dof : dof + 3])
    position = parent.pose.position + rotate(parent.pose.quaternion, body.position)
    quaternion = multiply(parent.pose.quaternion, body.quaternion)
    spin, spin_up = parent.angular_velocity, parent.angular_acceleration
    acceleration = parent.linear_acceleration + _carried(spin, spin_up, position - parent.pose.position)
    for joint in body.joints:
        if joint.kind == _SLIDE:
            axis = rotate(quaternion, joint.axis)
            shift = axis * (qpos[joint.qpos] - joint.zero)
            rate = axis * qvel[joint.dof]
            acceleration = acceleration + _carried(spin, spin_up, shift) + axis * qacc[joint.dof]
            acceleration = acceleration + 2.0 * cross(spin, rate)  # Coriolis
            position = position + shift
            continue
        turned = multiply(quaternion, _turn(joint, qpos))
        if joint.kind == _BALL:
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
