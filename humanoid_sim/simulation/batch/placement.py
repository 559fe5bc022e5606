"""Where the robots of a batch start, and where a floating base is in MuJoCo's arrays."""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import FloatingBase
from humanoid_sim.simulation.model import JointAddresses

__all__ = ["Placement"]


class Placement:
    """The start of a robot that stands on its feet, or hangs on its fixed base, with its joints anywhere."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription, joints: JointAddresses) -> None:
        """Find the description's own start."""
        data = mujoco.MjData(model)
        data.qpos[joints.qpos] = description.initial_position
        self._joints = joints
        self._dof_count = int(model.nv)
        self.base: tuple[slice, slice, slice, slice] | None = None
        """Of a floating base: position and orientation in `qpos`, linear and angular velocity in `qvel`."""
        if description.is_floating:
            FloatingBase(model, description, data.qpos).place(data)
            joint = int(model.body_jntadr[model.body(description.base.body).id])
            q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
            self.base = slice(q, q + 3), slice(q + 3, q + 7), slice(v, v + 3), slice(v + 3, v + 6)
        self._start: FloatArray = data.qpos.copy()

    def position(self, count: int, joint_position: FloatArray | None, base_yaw: FloatArray | None) -> FloatArray:
        """MuJoCo's generalised position, shape (k, nq).

        Args:
            count: k.
            joint_position: shape (k, n), rad; None for the description's initial position.
            base_yaw: shape (k,), rad, about the vertical, by which a floating base is turned; None for not at all.
        """
        qpos = np.repeat(self._start[None], count, axis=0)
        if joint_position is not None:
            qpos[:, self._joints.qpos] = joint_position
        if base_yaw is not None and self.base is not None:
            half, none = 0.5 * np.asarray(base_yaw), np.zeros(count)
            turn = np.stack([np.cos(half), none, none, np.sin(half)], axis=-1)
            qpos[:, self.base[1]] = multiply(turn, self._start[self.base[1]])
        return qpos

    def velocity(self, count: int, joint_velocity: FloatArray | None) -> FloatArray:
        """MuJoCo's generalised velocity, shape (k, nv); joints (k, n), rad/s, None for rest."""
        qvel = np.zeros((count, self._dof_count))
        if joint_velocity is not None:
            qvel[:, self._joints.dof] = joint_velocity
        return qvel
