"""What a simulated robot measures beside its joints: the IMU, and what only a simulation or an estimator knows.

All of it is computed from `qpos` and `qvel`: after `mj_step` MuJoCo's `sensordata`, and the poses in `MjData`, are one
physics step older.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import (
    ANCHOR_POSE,
    BASE_LINEAR_VELOCITY,
    EXTERN_WIDTHS,
    IMU,
    KEY_PRESSED,
    FloatArray,
    point_velocity,
)
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.keys import PianoKeys
from humanoid_sim.simulation.model import body_ids

__all__ = ["BodySample", "BodySensors", "Imu", "ImuSample", "live_inputs"]


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
        self._object, self._id = _frame(model, name)
        body = int(model.site_bodyid[self._id]) if self._object == mujoco.mjtObj.mjOBJ_SITE else self._id
        self._twist = np.empty(6)
        self.constant: ImuSample | None = None
        """What it always reads where it is fixed to the world; None where it moves."""
        if model.body_weldid[body] == 0:  # it feels gravity, for ever
            mujoco.mj_kinematics(model, self._data)
            quaternion, rotation = self._orientation()
            self.constant = ImuSample(quaternion, np.zeros(3), -rotation.T @ model.opt.gravity)

    def read(self, data: mujoco.MjData, acceleration: FloatArray | None = None) -> ImuSample:
        """The reading at the data's present `qpos` and `qvel`.

        Args:
            data: of the model.
            acceleration: shape (nv,), of the latest physics step, as `Plant.acceleration`; None for `qacc`, which is
                the same where no joint of the model has damping of its own.
        """
        return self.constant or self._compute(data.qpos, data.qvel, data.qacc if acceleration is None else acceleration)

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


def _frame(model: mujoco.MjModel, name: str) -> tuple[mujoco.mjtObj, int]:
    """What has the frame of that name, and its id: a site, or else a body.

    Raises:
        InputError: there is neither.
    """
    # A body's own axes; mjOBJ_BODY stands for those of its inertia.
    for kind in (mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_XBODY):
        i = mujoco.mj_name2id(model, kind, name)
        if i >= 0:
            return kind, i
    raise InputError(f"imu: '{name}' is neither a site nor a body of the model")


def live_inputs(
    model: mujoco.MjModel, description: RobotDescription, anchor_body: str, velocity_at: Sequence[str] = ()
) -> Mapping[str, int]:
    """Names and widths of the live inputs that a simulated robot's state carries.

    Args:
        model: of the robot.
        description: of the robot; only a floating base has velocities.
        anchor_body: MJCF body whose pose is asked for; empty for none.
        velocity_at: `imu`, or sites, whose velocity is asked for.

    Raises:
        InputError: the anchor body, or a site, is not in the model.
    """
    known = [model.site(i).name for i in range(model.nsite) if model.site(i).name]
    for point in velocity_at:
        if point != IMU and point not in known:
            what = known_names("site", point, known)
            raise InputError(f"velocity of the base: at is neither base nor imu nor a site of the model: {what}")
    names = [BASE_LINEAR_VELOCITY] if description.is_floating else []
    if anchor_body:
        names.append(ANCHOR_POSE)
        try:
            body_ids(model, [anchor_body])
        except InputError as error:
            raise InputError(f"anchor body: {error}") from None
    points = [point_velocity(point) for point in velocity_at] if description.is_floating else []
    keys = {KEY_PRESSED: KEY_COUNT} if description.piano is not None else {}
    return MappingProxyType({**{name: EXTERN_WIDTHS[name] for name in names}, **dict.fromkeys(points, 3), **keys})


@dataclass(frozen=True, slots=True, eq=False)
class BodySample:
    """One reading."""

    imu: ImuSample
    live: Mapping[str, FloatArray]
    """Live inputs by name, as in `humanoid_sim.mit.EXTERN_WIDTHS`, and `point_velocity` of each point asked for."""


class BodySensors:
    """Reads the IMU, velocities of a floating base, the pose of an anchor body, a piano's keys. Not thread-safe."""

    def __init__(
        self,
        model: mujoco.MjModel,
        description: RobotDescription,
        anchor_body: str = "",
        velocity_at: Sequence[str] = (),
    ) -> None:
        """Find the frames.

        Args:
            model: of the robot.
            description: says where the IMU is.
            anchor_body: MJCF body whose pose is asked for; empty for none.
            velocity_at: `imu`, or sites, whose velocity is asked for.

        Raises:
            InputError: the IMU, the anchor body or a site is not in the model.
        """
        self.widths = live_inputs(model, description, anchor_body, velocity_at)
        """Names and widths of the live inputs."""
        self._imu = Imu(model, description.imu)
        self._base_velocity = base_addresses(model, description)[2] if description.is_floating else None
        self._model, self._data = model, mujoco.MjData(model)
        self._anchor = model.body(anchor_body).id if anchor_body else None
        self._points = (
            {point_velocity(point): _frame(model, description.imu if point == IMU else point) for point in velocity_at}
            if description.is_floating
            else {}
        )
        self._twist = np.empty(6)
        self._keys = PianoKeys(model) if description.piano is not None else None

    def read(self, data: mujoco.MjData, acceleration: FloatArray | None = None) -> BodySample:
        """The reading at the data's present `qpos` and `qvel`; the acceleration is as `Imu.read` takes it."""
        live = {}
        if self._base_velocity is not None:
            live[BASE_LINEAR_VELOCITY] = data.qvel[self._base_velocity].copy()
        own = self._data
        if self._anchor is not None or self._points:
            own.qpos[:], own.qvel[:] = data.qpos, data.qvel
            mujoco.mj_kinematics(self._model, own)
        if self._points:
            mujoco.mj_comPos(self._model, own)
            mujoco.mj_comVel(self._model, own)
        for name, (kind, i) in self._points.items():
            mujoco.mj_objectVelocity(self._model, own, kind, i, self._twist, 0)
            live[name] = self._twist[3:].copy()
        if self._anchor is not None:
            live[ANCHOR_POSE] = np.concatenate([own.xpos[self._anchor], own.xquat[self._anchor]])
        if self._keys is not None:
            live[KEY_PRESSED] = self._keys.pressed(data.qpos)
        return BodySample(self._imu.read(data, acceleration), live)
