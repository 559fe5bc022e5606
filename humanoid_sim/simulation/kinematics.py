"""Quantities that follow from joint positions alone: poses of bodies, torques that hold them, and the way back.

Each object keeps a model and its buffers: one per thread.
"""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, body_ids, build_model, joint_addresses, named_frame

_LENGTH = 0.3  # m per rad, between an orientation and a position error; about a forearm with hand
_LARGEST_STEP = 0.3  # rad per iteration and joint, so that a far target does not throw the arm across a singularity


class _Posed:
    """A robot without a room, to be put into any pose."""

    def __init__(self, description: RobotDescription, model: mujoco.MjModel | None = None) -> None:
        self._model = build_model(description, scene=False) if model is None else model
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, description.joint_names)
        mujoco.mj_kinematics(self._model, self._data)
        base = base_body(self._model, description)
        self._base_position = self._data.xpos[base].copy()  # in the world; the joints do not move it
        self._base_rotation = self._data.xmat[base].reshape(3, 3).copy()

    def _pose(self, joint_position: FloatArray) -> None:
        self._data.qpos[self._addresses.qpos] = joint_position
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)


class ForwardKinematics(_Posed):
    """Poses of named bodies relative to the base: the body that holds the arms, the chest of the Lite."""

    def __init__(
        self,
        description: RobotDescription,
        bodies: tuple[str, ...] | None = None,
        model: mujoco.MjModel | None = None,
    ) -> None:
        """Find the bodies, None for the description's hands. Raises `InputError` for one that the model lacks."""
        super().__init__(description, model)
        self.bodies = description.hands if bodies is None else bodies
        with blaming(description.name, InputError):
            self._ids = list(body_ids(self._model, self.bodies))

    def __call__(self, joint_position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (..., B, 3), m, and rotation matrices (..., B, 3, 3) of the bodies in the base frame.

        `joint_position` is of shape (..., n), rad.
        """
        q = np.asarray(joint_position, dtype=np.float64)
        flat, b = q.reshape(-1, q.shape[-1]), len(self._ids)
        position, rotation = np.empty((len(flat), b, 3)), np.empty((len(flat), b, 9))
        for i, row in enumerate(flat):
            self._pose(row)
            position[i], rotation[i] = self._data.xpos[self._ids], self._data.xmat[self._ids]
        position = np.einsum("ji,tbj->tbi", self._base_rotation, position - self._base_position)
        matrices = np.einsum("ji,tbjk->tbik", self._base_rotation, rotation.reshape(-1, b, 3, 3))
        return position.reshape(*q.shape[:-1], b, 3), matrices.reshape(*q.shape[:-1], b, 3, 3)


class GravityTorque(_Posed):
    """Gravity compensation: `effort = clip(qfrc_bias, ±effort_limit)` at zero velocity."""

    def __init__(self, description: RobotDescription, model: mujoco.MjModel | None = None) -> None:
        super().__init__(description, model)
        self._limit = description.effort_limit
        self._bias = np.empty(self._model.nv)

    def __call__(self, joint_position: FloatArray) -> FloatArray:
        """Return the torque, shape (n,), N·m, at positions (n,), rad; without friction, which only helps to hold."""
        self._pose(joint_position)
        mujoco.mj_rne(self._model, self._data, 0, self._bias)  # qvel stays zero: no Coriolis terms
        return np.clip(self._bias[self._addresses.dof], -self._limit, self._limit)


class InverseKinematics(_Posed):
    """Joint positions that bring bodies to given poses in the base frame, within the joints' limits.

    Damped least squares (Wampler 1986); `damping`, m/rad, is steadier near singular poses and slower if larger.
    """

    def __init__(
        self,
        description: RobotDescription,
        bodies: tuple[str, ...],
        *,
        damping: float = 0.01,
        model: mujoco.MjModel | None = None,
    ) -> None:
        super().__init__(description, model)
        self._ids = [self._model.body(name).id for name in bodies]
        self._lower, self._upper, self._damping = description.lower, description.upper, damping

    def solve(
        self,
        position: FloatArray,
        rotation: FloatArray,
        start: FloatArray,
        *,
        posture: FloatArray | None = None,
        iterations: int = 20,
    ) -> FloatArray:
        """Return the joint positions, shape (n,), rad, for one pose: (B, 3), m, and (B, 3, 3), base frame.

        The search begins at `start`, (n,), rad, and ends when a step is below a microradian. In the directions that
        move no body the joints drift to `posture`, (n,), rad; None for nowhere.
        """
        world_position = self._base_position + position @ self._base_rotation.T
        world_rotation = self._base_rotation @ rotation
        q = np.clip(start, self._lower, self._upper)
        for _ in range(iterations):
            error, jacobian = self._linearise(q, world_position, world_rotation)
            normal = jacobian.T @ jacobian + self._damping**2 * np.eye(len(q))
            step = np.linalg.solve(normal, jacobian.T @ error)
            if posture is not None:  # what the damped inverse leaves of the pull lies (almost) in the null space
                pull = 0.2 * (posture - q)
                step += pull - np.linalg.solve(normal, jacobian.T @ (jacobian @ pull))
            step = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            q = np.clip(q + step, self._lower, self._upper)
            if np.abs(step).max() < 1e-6:
                break
        return q

    def solve_path(
        self, position: FloatArray, rotation: FloatArray, start: FloatArray, *, posture: FloatArray | None = None
    ) -> FloatArray:
        """Solve poses (F, B, 3) and (F, B, 3, 3), each search beginning at the solution before: (F, n), rad."""
        path = np.empty((len(position), len(start)))
        q = start
        for k, (p, r) in enumerate(zip(position, rotation, strict=True)):
            q = path[k] = self.solve(p, r, q, posture=posture, iterations=100 if k == 0 else 20)
        return path

    def _linearise(self, q: FloatArray, position: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return stacked pose errors (6 B,) and their Jacobian (6 B, n), world frame; rotations scaled to metres."""
        model, data, dof = self._model, self._data, self._addresses.dof
        self._pose(q)
        rows, errors = [], []
        jac_position, jac_rotation = np.empty((3, model.nv)), np.empty((3, model.nv))
        quaternion, turn = np.empty(4), np.empty(3)  # rad, axis times angle
        for i, body in enumerate(self._ids):
            mujoco.mj_jacBody(model, data, jac_position, jac_rotation, body)
            rows += [jac_position[:, dof], _LENGTH * jac_rotation[:, dof]]
            mujoco.mju_mat2Quat(quaternion, (rotation[i] @ data.xmat[body].reshape(3, 3).T).ravel())
            mujoco.mju_quat2Vel(turn, quaternion, 1.0)
            errors += [position[i] - data.xpos[body], _LENGTH * turn]
        return np.concatenate(errors), np.concatenate(rows)


class AnchorOrientation(_Posed):
    """Orientation of a body by the IMU and the joints between them, as a real robot knows it."""

    def __init__(self, description: RobotDescription, body: str) -> None:
        """Find IMU and body. Raises `InputError` if the body is not in the robot's model."""
        super().__init__(description)
        kind, i = named_frame(self._model, description.imu, "imu")
        is_site = kind == mujoco.mjtObj.mjOBJ_SITE
        self._imu_body = int(self._model.site_bodyid[i]) if is_site else i
        self._imu_in_body = self._model.site_quat[i] if is_site else np.array([1.0, 0.0, 0.0, 0.0])
        with blaming("anchor body", InputError):
            self._body = int(body_ids(self._model, [body])[0])

    def read(self, joint_position: FloatArray, imu_quaternion: FloatArray) -> FloatArray:
        """Return the body's quaternion (4,), w x y z, in the world of the IMU's; NaN where a joint between is."""
        self._pose(joint_position)
        imu = multiply(self._data.xquat[self._imu_body], self._imu_in_body)
        return multiply(imu_quaternion, multiply(conjugate(imu), self._data.xquat[self._body]))
