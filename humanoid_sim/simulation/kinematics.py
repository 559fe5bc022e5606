"""Quantities that follow from joint positions alone, by a separate model: poses of bodies, torques that hold them."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, body_ids, build_model, joint_addresses


class ForwardKinematics:
    """Poses of named bodies relative to the base: the body that holds the arms, the chest of the Lite.

    Keeps one model and its buffers; one instance per thread.
    """

    def __init__(self, description: RobotDescription, bodies: tuple[str, ...] | None = None) -> None:
        """Build the model; `bodies` None stands for the description's hands.

        Raises:
            InputError: a body is not in the model; the message lists those that are.
        """
        self._model = build_model(description, scene=False)
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, description.joint_names)
        self.bodies = description.hands if bodies is None else tuple(bodies)
        try:
            self._ids = list(body_ids(self._model, self.bodies))
        except InputError as error:
            raise InputError(f"{description.name}: {error}") from None
        mujoco.mj_kinematics(self._model, self._data)
        base = base_body(self._model, description)
        # The joints do not move the base, so its pose is taken once.
        self._base_position = self._data.xpos[base].copy()
        self._base_rotation = self._data.xmat[base].reshape(3, 3).copy()

    def __call__(self, joint_position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and rotation matrices of the bodies, in the order of `bodies`.

        Args:
            joint_position: shape (..., n), rad, joint frame.

        Returns:
            Shape (..., B, 3), m, and (..., B, 3, 3), both in the base frame; new arrays.
        """
        q = np.asarray(joint_position, dtype=np.float64)
        flat = q.reshape(-1, q.shape[-1])
        position = np.empty((len(flat), len(self._ids), 3))
        rotation = np.empty((len(flat), len(self._ids), 9))
        model, data, qpos_index = self._model, self._data, self._addresses.qpos
        for i, row in enumerate(flat):
            data.qpos[qpos_index] = row
            mujoco.mj_kinematics(model, data)
            position[i] = data.xpos[self._ids]
            rotation[i] = data.xmat[self._ids]
        position = np.einsum("ji,tbj->tbi", self._base_rotation, position - self._base_position)
        matrices = np.einsum("ji,tbjk->tbik", self._base_rotation, rotation.reshape(*rotation.shape[:2], 3, 3))
        batch = q.shape[:-1]
        return position.reshape(*batch, -1, 3), matrices.reshape(*batch, -1, 3, 3)


class GravityTorque:
    """Gravity compensation: `effort = clip(qfrc_bias, ±effort_limit)` at zero velocity. One instance per thread."""

    def __init__(self, description: RobotDescription, model: mujoco.MjModel | None = None) -> None:
        """Build the model, or take one of the robot that nobody else uses.

        Raises:
            InputError: see `build_model`.
        """
        self._model = build_model(description, scene=False) if model is None else model
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, description.joint_names)
        self._limit = description.effort_limit
        self._bias = np.empty(self._model.nv)

    def __call__(self, joint_position: FloatArray) -> FloatArray:
        """Shape (n,), rad, joint frame → shape (n,), N·m, joint frame, within the effort limits.

        Friction is not included; it only helps to hold.
        """
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = joint_position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)  # qvel stays zero: no Coriolis terms
        return np.clip(self._bias[self._addresses.dof], -self._limit, self._limit)


class MassMatrix:
    """The joints' inertia, motors included. One instance per thread."""

    def __init__(self, description: RobotDescription) -> None:
        """Build the model.

        Raises:
            InputError: see `build_model`.
        """
        self._model = build_model(description, scene=False)
        self._data = mujoco.MjData(self._model)
        self._addresses = joint_addresses(self._model, description.joint_names)
        self._whole = np.empty((self._model.nv, self._model.nv))

    def __call__(self, joint_position: FloatArray) -> FloatArray:
        """Shape (n,), rad, joint frame → shape (n, n), kg·m²; a new array."""
        model, data = self._model, self._data
        data.qpos[self._addresses.qpos] = joint_position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_makeM(model, data)
        mujoco.mj_fullM(model, data, self._whole)
        return self._whole[np.ix_(self._addresses.dof, self._addresses.dof)]
