"""The left arm in MuJoCo, and the right one as its mirror image: one network, and one set of training data, serve both.

The reflection S = diag(1, -1, 1) through the robot's middle plane takes a left body's pose (p, R) to its right
counterpart's (S p, S R D). D = diag(±1) belongs to the body: which of its own axes is reflected depends on how the
frames of the two sides were laid.
"""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, build_model, joint_addresses

__all__ = [
    "ARM_BODIES",
    "ARM_JOINTS",
    "JOINT_SIGN",
    "ORIENTATION_SIGN",
    "POSITION_SIGN",
    "ArmModel",
    "arm_joints",
    "both_arms",
]

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

_MARGIN = 0.03
"""Fraction of a joint's range that sampled poses keep from either limit."""


def both_arms(left: FloatArray, right: FloatArray) -> FloatArray:
    """Joint positions (..., 14) of the robot from those of two left arms (..., 7), the second one mirrored."""
    return np.concatenate([left, right * JOINT_SIGN], axis=-1)


def arm_joints(joints: FloatArray) -> FloatArray:
    """Return the inverse of `both_arms`: (..., 14) to (..., 2, 7), both as left arms."""
    arms = joints.reshape(*joints.shape[:-1], 2, ARM_JOINTS)
    left: FloatArray = arms * np.stack([np.ones(ARM_JOINTS), JOINT_SIGN])
    return left


class ArmModel:
    """The left arm; the right one stands mirrored in pose A, out of the way. Not thread-safe.

    Positions and Jacobians are in the base frame, whose axes are the world's: the Lite's chest is not turned.
    """

    def __init__(self, description: RobotDescription) -> None:
        model = build_model(description, scene=False)
        self._model, self._data = model, mujoco.MjData(model)
        addresses = joint_addresses(model, description.joint_names)
        self._qpos, self._dof = addresses.qpos[:ARM_JOINTS], addresses.dof[:ARM_JOINTS]
        self._bodies = [model.body(f"left_{name}").id for name in ARM_BODIES]
        self._is_right = [model.body(i).name.startswith("right_") for i in range(model.nbody)]
        self.home = np.array(description.standby_controller_a.pose_segments[-1])[:ARM_JOINTS]
        self.lower, self.upper = description.lower[:ARM_JOINTS], description.upper[:ARM_JOINTS]
        self.effort_limit = description.effort_limit[:ARM_JOINTS]
        self.stiffness, self.damping = description.stiffness[:ARM_JOINTS], description.damping[:ARM_JOINTS]
        self.friction = model.dof_frictionloss[self._dof].copy()
        self._data.qpos[addresses.qpos] = both_arms(self.home, self.home)
        mujoco.mj_kinematics(model, self._data)
        self._base = self._data.xpos[base_body(model, description)].copy()
        shoulder = model.body("left_shoulder_pitch").id
        self.shoulder: FloatArray = self._data.xpos[shoulder] - self._base

    def poses(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (F, 2, 3), m, and rotation matrices (F, 2, 3, 3) of elbow and hand; `q` is (F, 7), rad."""
        position, rotation = np.empty((len(q), 2, 3)), np.empty((len(q), 2, 9))
        for i, row in enumerate(q):
            self._place(row)
            position[i] = self._data.xpos[self._bodies]
            rotation[i] = self._data.xmat[self._bodies]
        return position - self._base, rotation.reshape(len(q), 2, 3, 3)

    def jacobians(self, q: FloatArray) -> FloatArray:
        """Shape (F, 2, 6, 7), m/rad and rad/rad: linear, then angular velocity of elbow and hand per joint velocity."""
        model, data = self._model, self._data
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        jacobian = np.empty((len(q), 2, 6, ARM_JOINTS))
        for i, row in enumerate(q):
            self._place(row)
            mujoco.mj_comPos(model, data)
            for k, body in enumerate(self._bodies):
                mujoco.mj_jacBody(model, data, linear, angular, body)
                jacobian[i, k, :3], jacobian[i, k, 3:] = linear[:, self._dof], angular[:, self._dof]
        return jacobian

    def dynamics(self, q: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mass matrices (F, 7, 7), kg·m², armature included, and bias torques (F, 7), N·m: gravity and Coriolis.

        Args:
            q: shape (F, 7), rad.
            velocity: shape (F, 7), rad/s.
        """
        model, data = self._model, self._data
        full, torque = np.empty((model.nv, model.nv)), np.empty(model.nv)
        mass, bias = np.empty((len(q), ARM_JOINTS, ARM_JOINTS)), np.empty((len(q), ARM_JOINTS))
        corner = np.ix_(self._dof, self._dof)
        for i, (row, rate) in enumerate(zip(q, velocity, strict=True)):
            self._place(row)
            data.qvel[self._dof] = rate
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_fullM(model, data, full)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 0, torque)
            mass[i], bias[i] = full[corner], torque[self._dof]
        data.qvel[self._dof] = 0.0
        return mass, bias

    def collides(self, q: FloatArray) -> bool:
        """Tell whether the arm in pose (7,), rad, touches itself, the torso or the head, not the other arm."""
        model, data = self._model, self._data
        self._place(q)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        bodies = model.geom_bodyid[data.contact.geom]
        return any(not (self._is_right[a] or self._is_right[b]) for a, b in bodies)

    def sample(self, rng: np.random.Generator, near_home: float = 0.4) -> FloatArray:
        """Draw a pose (7,), rad, without collision: from all over the limits, or, at times, from around pose A."""
        margin = _MARGIN * (self.upper - self.lower)
        while True:
            if rng.random() < near_home:
                q = self.home + rng.normal(0.0, 0.5, ARM_JOINTS)
            else:
                q = rng.uniform(self.lower, self.upper)
            q = np.clip(q, self.lower + margin, self.upper - margin)
            if not self.collides(q):
                return q

    def _place(self, q: FloatArray) -> None:
        self._data.qpos[self._qpos] = q
        mujoco.mj_kinematics(self._model, self._data)
