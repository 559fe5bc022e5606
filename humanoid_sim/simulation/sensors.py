"""Measurements of a simulated robot besides its joints: the IMU, and what only a simulation or an estimator knows.

All of it is computed from `qpos` and `qvel`: after `mj_step` MuJoCo's `sensordata`, and the poses in `MjData`, are one
physics step older.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import mujoco
import numpy as np

from humanoid_sim import mit
from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.rotation import conjugate, multiply
from humanoid_sim.errors import InputError, blaming, known_names
from humanoid_sim.mit import FloatArray, point_velocity
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.height_scan import HeightScanner
from humanoid_sim.simulation.keys import PianoKeys
from humanoid_sim.simulation.model import body_ids, build_model, joint_addresses, named_frame


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
        """Find the frame. Raises `InputError` if the model has neither a site nor a body of that name."""
        self._model = model
        self._data = mujoco.MjData(model)
        self._object, self._id = named_frame(model, name, "imu")
        body = int(model.site_bodyid[self._id]) if self._object == mujoco.mjtObj.mjOBJ_SITE else self._id
        self._twist = np.empty(6)
        self.constant: ImuSample | None = None
        """Constant reading where it is fixed to the world; None where it moves."""
        if model.body_weldid[body] == 0:  # it feels gravity, for ever
            mujoco.mj_kinematics(model, self._data)
            quaternion, rotation = self._orientation()
            self.constant = ImuSample(quaternion, np.zeros(3), -rotation.T @ model.opt.gravity)

    def read(self, data: mujoco.MjData, acceleration: FloatArray | None = None) -> ImuSample:
        """Return the reading at the data's present `qpos` and `qvel`.

        `acceleration`, shape (nv,), is of the latest physics step, as `Plant.acceleration`; None for `qacc`, which is
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
        """Return the frame's orientation in the world: quaternion (4,) w x y z, and rotation matrix (3, 3)."""
        matrices = self._data.site_xmat if self._object == mujoco.mjtObj.mjOBJ_SITE else self._data.xmat
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, matrices[self._id])
        return quaternion, matrices[self._id].reshape(3, 3)


def _pose(model: mujoco.MjModel, data: mujoco.MjData, kind: mujoco.mjtObj, i: int) -> FloatArray:
    """Position and quaternion (7,) of a site or body, world frame, as MuJoCo's sensors have it."""
    if kind != mujoco.mjtObj.mjOBJ_SITE:
        return np.concatenate([data.xpos[i], data.xquat[i]])
    quaternion = np.empty(4)
    mujoco.mju_mulQuat(quaternion, data.xquat[model.site_bodyid[i]], model.site_quat[i])
    return np.concatenate([data.site_xpos[i], quaternion])


def live_inputs(
    model: mujoco.MjModel,
    description: RobotDescription,
    anchor_body: str,
    velocity_at: Sequence[str] = (),
    height_scan: HeightScan | None = None,
) -> Mapping[str, int]:
    """Names and widths of the live inputs that a simulated robot's state carries; only a floating base has velocities.

    Raises `InputError` if the anchor body, or a site, is not in the model.

    Args:
        anchor_body: MJCF body whose pose is asked for; empty for none.
        velocity_at: `imu`, or sites, whose velocity is asked for.
        height_scan: of the ground, if it is asked for.
    """
    known = [model.site(i).name for i in range(model.nsite) if model.site(i).name]
    for point in velocity_at:
        if point != mit.IMU and point not in known:
            what = known_names("site", point, known)
            raise InputError(f"velocity of the base: at is neither base nor imu nor a site of the model: {what}")
    names = [mit.BASE_LINEAR_VELOCITY] if description.is_floating else []
    if anchor_body:
        names.append(mit.ANCHOR_POSE)
        with blaming("anchor body", InputError):
            body_ids(model, [anchor_body])
    points = [point_velocity(point) for point in velocity_at] if description.is_floating else []
    keys = {mit.KEY_PRESSED: KEY_COUNT} if description.piano is not None else {}
    scan = {} if height_scan is None else {mit.HEIGHT_SCAN: height_scan.count}
    known_widths = {name: mit.EXTERN_WIDTHS[name] for name in names}
    return MappingProxyType({**known_widths, **dict.fromkeys(points, 3), **keys, **scan})


@dataclass(frozen=True, slots=True, eq=False)
class BodySample:
    """One reading."""

    imu: ImuSample
    live: Mapping[str, FloatArray]
    """Live inputs by name, as in `humanoid_sim.mit.EXTERN_WIDTHS`, and `point_velocity` of each point asked for."""


class BodySensors:
    """Reads the IMU, velocities of a floating base, an anchor body's pose, a piano's keys, the ground's height.

    Not thread-safe.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        description: RobotDescription,
        anchor_body: str = "",
        velocity_at: Sequence[str] = (),
        height_scan: HeightScan | None = None,
    ) -> None:
        """Find the frames; arguments as of `live_inputs`.

        Raises `InputError` if the IMU, the anchor body, a site or the middle of the scan is not in the model.
        """
        self.widths = live_inputs(model, description, anchor_body, velocity_at, height_scan)
        """Names and widths of the live inputs."""
        self._imu = Imu(model, description.imu)
        self._base_velocity = base_addresses(model, description)[2] if description.is_floating else None
        self._model, self._data = model, mujoco.MjData(model)
        self._anchor = model.body(anchor_body).id if anchor_body else None
        self._points = {
            point_velocity(point): named_frame(model, description.imu if point == mit.IMU else point, "imu")
            for point in (velocity_at if description.is_floating else ())
        }
        self._twist = np.empty(6)
        self._keys = PianoKeys(model) if description.piano is not None else None
        self._scanner = None if height_scan is None else HeightScanner(model, description, height_scan)

    def read(self, data: mujoco.MjData, acceleration: FloatArray | None = None) -> BodySample:
        """Return the reading at the data's present `qpos` and `qvel`; the acceleration is as `Imu.read` takes it."""
        live = {}
        if self._base_velocity is not None:
            live[mit.BASE_LINEAR_VELOCITY] = data.qvel[self._base_velocity].copy()
        own = self._data
        if self._anchor is not None or self._points or self._scanner is not None:
            own.qpos[:], own.qvel[:] = data.qpos, data.qvel
            mujoco.mj_kinematics(self._model, own)
        if self._points:
            mujoco.mj_comPos(self._model, own)
            mujoco.mj_comVel(self._model, own)
        for name, (kind, i) in self._points.items():
            mujoco.mj_objectVelocity(self._model, own, kind, i, self._twist, 0)
            live[name] = self._twist[3:].copy()
        if self._anchor is not None:
            live[mit.ANCHOR_POSE] = _pose(self._model, own, mujoco.mjtObj.mjOBJ_XBODY, self._anchor)
        if self._keys is not None:
            live[mit.KEY_PRESSED] = self._keys.pressed(data.qpos)
        if self._scanner is not None:
            live[mit.HEIGHT_SCAN] = self._scanner.read(_pose(self._model, own, *self._scanner.frame))
        return BodySample(self._imu.read(data, acceleration), live)


class AnchorOrientation:
    """Orientation of a body by the IMU and the joints between them, as a real robot knows it. Not thread-safe."""

    def __init__(self, description: RobotDescription, body: str) -> None:
        """Find IMU and body in the robot's model. Raises `InputError` if the body is not in it."""
        self._model = build_model(description, scene=False)
        self._data = mujoco.MjData(self._model)
        self._qpos = joint_addresses(self._model, description.joint_names).qpos
        self._imu = named_frame(self._model, description.imu, "imu")
        with blaming("anchor body", InputError):
            self._body = int(body_ids(self._model, [body])[0])

    def read(self, joint_position: FloatArray, imu_quaternion: FloatArray) -> FloatArray:
        """Return the body's quaternion (4,), w x y z, in the world of the IMU's; NaN where a joint between is."""
        self._data.qpos[self._qpos] = joint_position
        mujoco.mj_kinematics(self._model, self._data)
        imu = _pose(self._model, self._data, *self._imu)[3:]
        return multiply(imu_quaternion, multiply(conjugate(imu), self._data.xquat[self._body]))
