"""Inverse kinematics by damped least squares (Wampler 1986): how motions are made, and the baseline of the report."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, build_model, joint_addresses

_LENGTH = 0.3
"""m per rad: how an orientation error is weighed against a position error; about the length of a forearm with hand."""
_LARGEST_STEP = 0.3
"""rad per iteration and joint, so that a far target does not throw the arm across a singularity."""


def damped_step(jacobian: FloatArray, error: FloatArray, damping: float, pull: FloatArray | None = None) -> FloatArray:
    """One step of damped least squares, shape (n,), rad.

    Args:
        jacobian: shape (m, n), of the error.
        error: shape (m,), that the step should take away.
        damping: in the jacobian's unit; larger is steadier near singular poses.
        pull: shape (n,), rad, that is followed in the directions in which it changes no error; None for none.
    """
    normal = jacobian.T @ jacobian + damping**2 * np.eye(jacobian.shape[1])
    step = np.linalg.solve(normal, jacobian.T @ error)
    if pull is not None:
        # What the damped inverse leaves of the pull lies (almost) in the null space.
        step += pull - np.linalg.solve(normal, jacobian.T @ (jacobian @ pull))
    bounded: FloatArray = np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
    return bounded


class InverseKinematics:
    """Joint positions that bring bodies to given poses in the base frame, within the joints' limits."""

    def __init__(self, description: RobotDescription, bodies: tuple[str, ...], *, damping: float = 0.01) -> None:
        """Build the model.

        Args:
            description: the robot.
            bodies: names of the B bodies.
            damping: m/rad; larger is steadier near singular poses, and slower to converge.
        """
        self._model = build_model(description, scene=False)
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, description.joint_names)
        self._ids = [self._model.body(name).id for name in bodies]
        self._lower, self._upper = description.lower, description.upper
        self._damping = damping
        mujoco.mj_kinematics(self._model, self._data)
        base = base_body(self._model, description)
        self._base_position = self._data.xpos[base].copy()
        self._base_rotation = self._data.xmat[base].reshape(3, 3).copy()

    def solve(
        self,
        position: FloatArray,
        rotation: FloatArray,
        start: FloatArray,
        *,
        posture: FloatArray | None = None,
        iterations: int = 20,
    ) -> FloatArray:
        """One pose.

        Args:
            position: shape (B, 3), m, base frame.
            rotation: shape (B, 3, 3), base frame.
            start: shape (n,), rad, where the search begins.
            posture: shape (n,), rad, where the joints drift in the directions that move no body; None for nowhere.
            iterations: at most this many; the search ends when a step is below a microradian.

        Returns:
            Shape (n,), rad.
        """
        world_position = self._base_position + position @ self._base_rotation.T
        world_rotation = self._base_rotation @ rotation
        q = np.clip(start, self._lower, self._upper)
        for _ in range(iterations):
            error, jacobian = self._linearise(q, world_position, world_rotation)
            step = damped_step(jacobian, error, self._damping, None if posture is None else 0.2 * (posture - q))
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
        """Stacked pose errors (6 B,) and their Jacobian (6 B, n), world frame; rotations scaled to metres."""
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        rows, errors = [], []
        jac_position, jac_rotation = np.empty((3, model.nv)), np.empty((3, model.nv))
        quaternion, turn = np.empty(4), np.empty(3)  # rad, axis times angle
        for i, body in enumerate(self._ids):
            mujoco.mj_jacBody(model, data, jac_position, jac_rotation, body)
            rows += [jac_position[:, self._addresses.dof], _LENGTH * jac_rotation[:, self._addresses.dof]]
            mujoco.mju_mat2Quat(quaternion, (rotation[i] @ data.xmat[body].reshape(3, 3).T).ravel())
            mujoco.mju_quat2Vel(turn, quaternion, 1.0)
            errors += [position[i] - data.xpos[body], _LENGTH * turn]
        return np.concatenate(errors), np.concatenate(rows)
