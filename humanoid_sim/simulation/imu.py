"""The IMU, computed from `qpos` and `qvel`; MuJoCo's `sensordata` would be one physics step older."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray

__all__ = ["Imu", "ImuSample"]


@dataclass(frozen=True, slots=True, eq=False)
class ImuSample:
    """One reading."""

    quaternion: FloatArray
    """Shape (4,), w x y z, IMU frame in the world frame."""
    angular_velocity: FloatArray
    """Shape (3,), rad/s, IMU frame."""
    linear_acceleration: FloatArray
    """Shape (3,), m/s², IMU frame, gravity included: (0, 0, +9.81) at rest and upright."""


class Imu:
    """An ideal IMU at a site or body of the model. Keeps its own `MjData`; not thread-safe."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Find the frame `name`.

        Raises:
            InputError: the model has neither a site nor a body of that name.
        """
        self._model = model
        self._data = mujoco.MjData(model)
        self._object = mujoco.mjtObj.mjOBJ_SITE
        self._id = mujoco.mj_name2id(model, self._object, name)
        if self._id >= 0:
            body = int(model.site_bodyid[self._id])
        else:
            self._object = mujoco.mjtObj.mjOBJ_XBODY  # the body's own axes; mjOBJ_BODY stands for those of its inertia
            body = self._id = mujoco.mj_name2id(model, self._object, name)
            if body < 0:
                raise InputError(f"imu: '{name}' is neither a site nor a body of the model")
        self._twist = np.empty(6)
        self.constant: ImuSample | None = None
        """What it always reads where it is fixed to the world; None where it moves."""
        if model.body_weldid[body] == 0:  # it feels gravity, for ever
            mujoco.mj_kinematics(model, self._data)
            quaternion, rotation = self._orientation()
            self.constant = ImuSample(quaternion, np.zeros(3), -rotation.T @ model.opt.gravity)

    def read(self, data: mujoco.MjData) -> ImuSample:
        """The reading at the data's present `qpos` and `qvel`, with the acceleration of its latest physics step."""
        return self.constant or self._compute(data.qpos, data.qvel, data.qacc)

    def _compute(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> ImuSample:
        model, data, twist = self._model, self._data, self._twist
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)  # body accelerations, with gravity as an upward acceleration
        quaternion, _ = self._orientation()
        mujoco.mj_objectVelocity(model, data, self._object, self._id, twist, 1)
        angular_velocity = twist[:3].copy()
        mujoco.mj_objectAcceleration(model, data, self._object, self._id, twist, 1)
        return ImuSample(quaternion, angular_velocity, twist[3:].copy())

    def _orientation(self) -> tuple[FloatArray, FloatArray]:
        """The frame's orientation in the world: quaternion (4,) w x y z, and rotation matrix (3, 3)."""
        matrices = self._data.site_xmat if self._object == mujoco.mjtObj.mjOBJ_SITE else self._data.xmat
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, matrices[self._id])
        return quaternion, matrices[self._id].reshape(3, 3)
