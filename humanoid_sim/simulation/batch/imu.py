"""The IMU of every environment of a batch, computed as `humanoid_sim.simulation.imu` computes one."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.body_tree import BodyTree
from humanoid_sim.simulation.batch.rows import column, cross, multiply, normalize, rotate, rotate_inverse

__all__ = ["BatchImu", "ImuReading"]


@dataclass(frozen=True, slots=True, eq=False)
class ImuReading:
    """One reading of N sensors."""

    quaternion: FloatArray
    """Shape (N, 4), w x y z, IMU frame in the world frame."""
    angular_velocity: FloatArray
    """Shape (N, 3), rad/s, IMU frame."""
    linear_acceleration: FloatArray
    """Shape (N, 3), m/s², IMU frame, gravity included: (0, 0, +9.81) at rest and upright."""


class BatchImu:
    """An ideal IMU at a site or body of the model."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Find the frame `name`.

        Raises:
            InputError: the model has neither a site nor a body of that name.
        """
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
        if site >= 0:
            self._body = int(model.site_bodyid[site])
            self._offset, self._turn = column(model.site_pos[site]), column(model.site_quat[site])
        else:
            self._body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if self._body < 0:
                raise InputError(f"imu: '{name}' is neither a site nor a body of the model")
            self._offset, self._turn = np.zeros((3, 1)), column(np.array([1.0, 0.0, 0.0, 0.0]))
        self._tree = BodyTree(model, [self._body])
        self._gravity = column(model.opt.gravity)
        self._constant: tuple[FloatArray, FloatArray, FloatArray] | None = None
        if int(model.body_weldid[self._body]) == 0:  # it feels gravity, for ever
            nothing = np.empty((1, 0))
            self._constant = self._rows(nothing, nothing, nothing)

    def read(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> ImuReading:
        """The readings, new arrays.

        Args:
            qpos: shape (N, nq).
            qvel: shape (N, nv).
            qacc: shape (N, nv), of the latest physics step.
        """
        rows = self._constant or self._rows(qpos, qvel, qacc)
        return ImuReading(*(np.broadcast_to(part, (len(part), len(qpos))).T.copy() for part in rows))

    def _rows(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three parts of the readings, (4, N), (3, N) and (3, N)."""
        motion = self._tree.motion(self._body, qpos, qvel, qacc)
        arm = rotate(motion.pose.quaternion, self._offset)
        spin = motion.angular_velocity
        acceleration = (
            motion.linear_acceleration
            + cross(motion.angular_acceleration, arm)
            + cross(spin, cross(spin, arm))
            - self._gravity
        )
        quaternion = multiply(motion.pose.quaternion, self._turn)
        return (
            _as_from_matrix(normalize(quaternion)),
            rotate_inverse(quaternion, spin),
            rotate_inverse(quaternion, acceleration),
        )


def _as_from_matrix(quaternion: FloatArray) -> FloatArray:
    """Of the two quaternions of a rotation the one that `mju_mat2Quat` gives; (4, N).

    Its scalar part is positive where the matrix's trace is (|w| > 1/2), otherwise its largest component is.
    """
    w, x, y, z = quaternion
    xx, yy, zz = x * x, y * y, z * z
    leading = np.where((xx > yy) & (xx > zz), x, np.where(yy > zz, y, z))
    leading = np.where(4.0 * w * w > 1.0, w, leading)
    return np.where(leading < 0.0, -quaternion, quaternion)
