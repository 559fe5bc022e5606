"""The torque that holds a robot still against gravity, from a model of its own: safe to use in another thread."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

__all__ = ["GravityTorque"]


class GravityTorque:
    """Gravity compensation: `effort = clip(qfrc_bias, ±effort_limit)` at zero velocity. One instance per thread."""

    def __init__(self, description: RobotDescription) -> None:
        """Build the model.

        Raises:
            InputError: see `build_model`.
        """
        self._model = build_model(description, scene=False)
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
