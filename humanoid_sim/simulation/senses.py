"""What a simulated robot feels beside its joints: the IMU, and what only a simulation or an estimator knows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, EXTERN_WIDTHS, FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import FloatingBase
from humanoid_sim.simulation.imu import Imu, ImuSample

__all__ = ["BodySample", "BodySenses"]


@dataclass(frozen=True, slots=True, eq=False)
class BodySample:
    """One reading."""

    imu: ImuSample
    live: Mapping[str, FloatArray]
    """Live inputs by name, as in `humanoid_sim.controllers.context`."""


class BodySenses:
    """Reads the IMU, the velocity of a floating base, and the pose of an anchor body.

    All of it belongs to the data's present `qpos` and `qvel`: body poses come from a kinematics pass of its own,
    because those in `MjData` are one physics step older after `mj_step`. Not thread-safe.
    """

    def __init__(
        self, model: mujoco.MjModel, description: RobotDescription, base: FloatingBase | None, anchor_body: str = ""
    ) -> None:
        """Find the frames.

        Args:
            model: of the robot.
            description: says where the IMU is.
            base: the floating base, None for a robot that has none.
            anchor_body: MJCF body whose pose is asked for; empty for none.

        Raises:
            InputError: the IMU or the anchor body is not in the model.
        """
        self._imu = Imu(model, description.imu)
        self._base = base
        self._anchor = _BodyPose(model, anchor_body) if anchor_body else None
        names = [BASE_LINEAR_VELOCITY] * (base is not None) + [ANCHOR_POSE] * bool(anchor_body)
        self.widths: Mapping[str, int] = MappingProxyType({name: EXTERN_WIDTHS[name] for name in names})
        """Names and widths of the live inputs."""

    def read(self, data: mujoco.MjData) -> BodySample:
        """The reading at the data's present `qpos` and `qvel`."""
        live = {}
        if self._base is not None:
            live[BASE_LINEAR_VELOCITY] = self._base.state(data).linear_velocity
        if self._anchor is not None:
            live[ANCHOR_POSE] = self._anchor.read(data)
        return BodySample(self._imu.read(data), live)


class _BodyPose:
    """The pose of one body in the world."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        known = [model.body(i).name for i in range(1, model.nbody)]
        if name not in known:
            raise InputError(f"anchor body: {known_names('body', name, known)}")
        self._model = model
        self._data = mujoco.MjData(model)
        self._id = model.body(name).id

    def read(self, data: mujoco.MjData) -> FloatArray:
        """Shape (7,): x y z in m and w x y z."""
        self._data.qpos[:] = data.qpos
        mujoco.mj_kinematics(self._model, self._data)
        return np.concatenate([self._data.xpos[self._id], self._data.xquat[self._id]])
