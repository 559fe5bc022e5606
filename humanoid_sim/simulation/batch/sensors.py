"""What the robots of a batch report: their true state, and what noise makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.errors import InputError
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, EXTERN_WIDTHS, Extern, FloatArray, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch.body_tree import BodyTree, body_ids
from humanoid_sim.simulation.batch.counter_random import Words, normals
from humanoid_sim.simulation.batch.imu import BatchImu
from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.model import JointAddresses

__all__ = ["BatchSensors"]

_NOISE_STREAM = 33


class BatchSensors:
    """Reads joints, IMU, the velocity of floating bases and the pose of an anchor body."""

    def __init__(
        self,
        model: mujoco.MjModel,
        description: RobotDescription,
        addresses: JointAddresses,
        randomisation: Randomisation,
        anchor_body: str,
    ) -> None:
        """Find the frames.

        Raises:
            InputError: the IMU or the anchor body is not in the model.
        """
        self._addresses = addresses
        self._noise = randomisation
        self._imu = BatchImu(model, description.imu)
        self._base_dof = -1
        if description.is_floating:
            joint = int(model.body_jntadr[model.body(description.base.body).id])
            self._base_dof = int(model.jnt_dofadr[joint])
        self._anchor: BodyTree | None = None
        if anchor_body:
            try:
                self._anchor = BodyTree(model, body_ids(model, [anchor_body]))
            except InputError as error:
                raise InputError(f"anchor body: {error}") from None
        names = [BASE_LINEAR_VELOCITY] * description.is_floating + [ANCHOR_POSE] * bool(anchor_body)
        self.widths: Mapping[str, int] = {name: EXTERN_WIDTHS[name] for name in names}
        """Names and widths of the live inputs."""

    def read(
        self, time: FloatArray, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray, effort: FloatArray
    ) -> MITState:
        """The true state of N robots at one instant each.

        Args:
            time: shape (N,), s.
            qpos: shape (N, nq).
            qvel: shape (N, nv).
            qacc: shape (N, nv), of the latest physics step.
            effort: shape (N, n), N·m.
        """
        position = qpos[:, self._addresses.qpos]
        reading = self._imu.read(qpos, qvel, qacc)
        return MITState(
            time=time,
            joint_position=position,
            joint_velocity=qvel[:, self._addresses.dof],
            joint_effort=effort,
            joint_age=np.zeros_like(position),
            imu_quaternion=reading.quaternion,
            imu_angular_velocity=reading.angular_velocity,
            imu_linear_acceleration=reading.linear_acceleration,
            extern=self._live(qpos, qvel),
        )

    def disturb(self, state: MITState, keys: Words, step: npt.NDArray[np.int64]) -> MITState:
        """What the sensors make of the true state.

        Args:
            state: from `read`.
            keys: shape (2, N), of the noise.
            step: shape (N,), which report since the environment's start this is.
        """
        noise, n = self._noise, state.joint_count
        if not noise.is_noisy:
            return state
        drawn = normals(keys, _NOISE_STREAM, step, 2 * n + 9)
        tilt = 0.5 * noise.orientation_noise * drawn[:, 2 * n : 2 * n + 3]
        turn = np.concatenate([np.ones((len(tilt), 1)), tilt], axis=1)
        turn /= np.sqrt((turn * turn).sum(axis=1, keepdims=True))
        spin, shake = drawn[:, 2 * n + 3 : 2 * n + 6], drawn[:, 2 * n + 6 :]
        return replace(
            state,
            joint_position=state.joint_position + noise.joint_position_noise * drawn[:, :n],
            joint_velocity=state.joint_velocity + noise.joint_velocity_noise * drawn[:, n : 2 * n],
            imu_quaternion=multiply(state.imu_quaternion, turn),
            imu_angular_velocity=state.imu_angular_velocity + noise.angular_velocity_noise * spin,
            imu_linear_acceleration=state.imu_linear_acceleration + noise.linear_acceleration_noise * shake,
        )

    def _live(self, qpos: FloatArray, qvel: FloatArray) -> Mapping[str, Extern]:
        live = {}
        if self._base_dof >= 0:
            live[BASE_LINEAR_VELOCITY] = Extern(qvel[:, self._base_dof : self._base_dof + 3], 0.0)
        if self._anchor is not None:
            pose = self._anchor.poses(qpos)[self._anchor.bodies[0]]
            value = np.concatenate([pose.position, pose.quaternion])
            live[ANCHOR_POSE] = Extern(np.broadcast_to(value, (7, len(qpos))).T, 0.0)
        return live
