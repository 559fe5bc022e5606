"""Sensors of a simulated robot, ordinary ones of MuJoCo, and the state that their readings make, of one or a batch.

The simulations leave `sensordata` as of the present: positions and velocities of the state reached, accelerations of
the physics step that led there.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import mujoco
import numpy as np

from humanoid_sim import mit
from humanoid_sim.errors import require_known
from humanoid_sim.mit import Extern, FloatArray, IndexArray, MITState, frozen_array, point_velocity
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT, TRIGGER, key_joint_names
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState, base_addresses
from humanoid_sim.simulation.height_scan import HeightScanner
from humanoid_sim.simulation.model import SimConfig, base_body, joint_addresses

_PREFIX = "humanoid_sim_"
_SITE, _BODY = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_XBODY
_KEY_SIZE = [1.0, 1.0, 1.0]  # m, half edges of a touch sensor's box: every contact of its key is inside


def add_sensors(spec: mujoco.MjSpec, description: RobotDescription, config: SimConfig) -> None:
    """Add the sensors of IMU, base, points, bodies and keys. Raises `InputError` if the model lacks one of them."""
    bodies = [body.name for body in spec.bodies if body.name]
    sites = [site.name for site in spec.sites if site.name]
    require_known("body", [config.anchor_body] if config.anchor_body else [], bodies, "anchor body: ")
    require_known("body", config.bodies, bodies)
    require_known("site", [point for point in config.velocity_at if point != mit.IMU], sites, "velocity of the base: ")
    base = spec.joint(description.joints[0].name).parent
    while base.parent.name != spec.worldbody.name:
        base = base.parent
    base.name = base.name or f"{_PREFIX}base"
    imu = description.imu
    if imu not in sites:
        imu = spec.body(imu).add_site(name=f"{_PREFIX}imu").name

    kind = mujoco.mjtSensor
    _add(spec, "imu_quaternion", kind.mjSENS_FRAMEQUAT, _SITE, imu)
    _add(spec, "imu_angular_velocity", kind.mjSENS_GYRO, _SITE, imu)
    if _moves(spec, spec.site(imu).parent):  # on what is fixed to the world MuJoCo's accelerometer measures nothing
        _add(spec, "imu_linear_acceleration", kind.mjSENS_ACCELEROMETER, _SITE, imu)
    if description.is_floating:
        _add(spec, "centre_of_mass", kind.mjSENS_SUBTREECOM, mujoco.mjtObj.mjOBJ_BODY, description.base.body)
        for point in config.velocity_at:
            site = imu if point == mit.IMU else point
            _add(spec, point_velocity(point), kind.mjSENS_FRAMELINVEL, _SITE, site)
    if config.anchor_body:
        _add_pose(spec, "anchor", _BODY, config.anchor_body)
    if config.height_scan is not None:
        at = config.height_scan.at
        frame = {mit.BASE: (_BODY, base.name), mit.IMU: (_SITE, imu)}.get(at, (_SITE if at in sites else _BODY, at))
        if frame[0] == _BODY:
            require_known("site or body", [frame[1]], bodies, "height scan: ")
        _add_pose(spec, "scan", *frame)
    for i, body in enumerate(config.bodies):
        _add_pose(spec, f"body_{i}", _BODY, body)
        _add_pose(spec, f"body_{i}_in_base", _BODY, body, base.name)
    for i, name in enumerate(key_joint_names() if description.piano is not None else ()):
        box = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": _KEY_SIZE, "group": 5}
        site = spec.joint(name).parent.add_site(name=f"{_PREFIX}key_{i}", **box)
        _add(spec, f"key_{i}", kind.mjSENS_TOUCH, _SITE, site.name)


def _moves(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> bool:
    while body.name != spec.worldbody.name:
        if body.joints:
            return True
        body = body.parent
    return False


def _add(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtSensor, objtype: mujoco.mjtObj, objname: str, base: str = ""
) -> None:
    frame = {"reftype": _BODY, "refname": base} if base else {}
    spec.add_sensor(name=_PREFIX + name, type=kind, objtype=objtype, objname=objname, **frame)


def _add_pose(spec: mujoco.MjSpec, name: str, objtype: mujoco.mjtObj, objname: str, base: str = "") -> None:
    """Add position and quaternion, which lie side by side in `sensordata`; in the world, or in the base's frame."""
    _add(spec, f"{name}_position", mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype, objname, base)
    _add(spec, f"{name}_quaternion", mujoco.mjtSensor.mjSENS_FRAMEQUAT, objtype, objname, base)


def live_inputs(description: RobotDescription, config: SimConfig) -> Mapping[str, int]:
    """Return names and widths of the live inputs that a simulated robot's state has."""
    widths = {}
    if description.is_floating:
        widths[mit.BASE_LINEAR_VELOCITY] = 3
        widths |= {point_velocity(point): 3 for point in config.velocity_at}
    if config.anchor_body:
        widths[mit.ANCHOR_POSE] = 7
    if description.piano is not None:
        widths[mit.KEY_PRESSED] = KEY_COUNT
    if config.height_scan is not None:
        widths[mit.HEIGHT_SCAN] = config.height_scan.count
    return MappingProxyType(widths)


class Sensors:
    """Reads the sensors that `add_sensors` added; arrays are (...), of one robot or of a batch. Not thread-safe."""

    def __init__(
        self, model: mujoco.MjModel, description: RobotDescription, config: SimConfig, count: int = 1, threads: int = 1
    ) -> None:
        """Find the addresses; `count` robots are scanned for ground at a time, on `threads`."""
        self.widths = live_inputs(description, config)  # names and widths of the live inputs
        self.joints = joints = joint_addresses(model, description.joint_names)
        self._qpos: slice | IndexArray
        self._dof: slice | IndexArray
        self._qpos, self._dof = joints.slices or (joints.qpos, joints.dof)
        sensors = [model.sensor(i) for i in range(model.nsensor)]
        at = {s.name.removeprefix(_PREFIX): slice(int(s.adr[0]), int(s.adr[0] + s.dim[0])) for s in sensors}
        self._quaternion, self._angular_velocity = at["imu_quaternion"], at["imu_angular_velocity"]
        self._acceleration = at.get("imu_linear_acceleration")
        self._gravity = np.zeros(3)
        if self._acceleration is None:  # the IMU is fixed to the world
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            rotation = data.site_xmat[model.sensor(f"{_PREFIX}imu_quaternion").objid[0]].reshape(3, 3)
            self._gravity = frozen_array("IMU", "gravity", -rotation.T @ model.opt.gravity)
        self._no_age = frozen_array("joints", "age", np.zeros(len(description.joint_names)))
        self._observer = BaseObserver(model, description) if description.is_floating else None
        self._live: dict[str, slice] = {}  # columns of `sensordata` by live input
        if description.is_floating:
            self._base_velocity = base_addresses(model, description)[2]
            self._centre_of_mass = at["centre_of_mass"]
            self._live = {name: at[name] for name in map(point_velocity, config.velocity_at)}
        if config.anchor_body:
            self._live[mit.ANCHOR_POSE] = _pose(at, "anchor")
        self._scanner: HeightScanner | None = None
        if config.height_scan is not None:
            self._scan = _pose(at, "scan")
            self._scanner = HeightScanner(model, base_body(model, description), config.height_scan, count, threads)
        firsts = np.array([at[f"body_{i}_position"].start for i in range(len(config.bodies))], dtype=np.intp)
        self._bodies = firsts[:, None] + np.arange(7)
        self._bodies_in_base = self._bodies + 7
        self._keys: IndexArray | None = None
        self.touch = slice(0)
        """Columns of `sensordata` with the force on each key, N, normal to the surfaces; none without a piano."""
        if description.piano is not None:
            self._keys = joint_addresses(model, key_joint_names()).qpos
            self._trigger = TRIGGER * np.array([model.joint(name).range[1] for name in key_joint_names()])
            self.touch = slice(at["key_0"].start, at["key_0"].start + KEY_COUNT)

    def state(
        self,
        time: float | FloatArray,
        qpos: FloatArray,
        qvel: FloatArray,
        sensordata: FloatArray,
        effort: FloatArray,
        encoder_offset: FloatArray | None = None,
    ) -> MITState:
        """Return the state at `time`, s, that MuJoCo's arrays (..., nq), … and efforts, shape (..., n), N·m, make.

        `encoder_offset`, shape (..., n), rad, is by how much the encoders show too much; None for none.
        """
        live = {}
        if self._observer is not None:
            live[mit.BASE_LINEAR_VELOCITY] = qvel[..., self._base_velocity]
        for name, columns in self._live.items():
            live[name] = sensordata[..., columns]
        if self._keys is not None:
            live[mit.KEY_PRESSED] = (qpos[..., self._keys] > self._trigger).astype(np.float64)
        if self._scanner is not None:
            live[mit.HEIGHT_SCAN] = self._scanner.scan(sensordata[..., self._scan])
        sampled = time if isinstance(time, float) else 0.0
        position = qpos[..., self._qpos]
        if self._acceleration is not None:
            acceleration = sensordata[..., self._acceleration]
        else:
            acceleration = self._gravity if effort.ndim == 1 else np.broadcast_to(self._gravity, (len(effort), 3))
        return MITState(
            time=time,
            joint_position=position if encoder_offset is None else position + encoder_offset,
            joint_velocity=qvel[..., self._dof],
            joint_effort=effort,
            joint_age=self._no_age if effort.ndim == 1 else np.zeros(effort.shape),
            imu_quaternion=sensordata[..., self._quaternion],
            imu_angular_velocity=sensordata[..., self._angular_velocity],
            imu_linear_acceleration=acceleration,
            extern={name: Extern(value, sampled) for name, value in live.items()},
        )

    def base(self, qpos: FloatArray, qvel: FloatArray, sensordata: FloatArray) -> BaseState | None:
        """Return pose and motion of a floating base; None for a fixed one."""
        if self._observer is None:
            return None
        return self._observer.at(qpos, qvel, sensordata[..., self._centre_of_mass].copy())

    def body_poses(self, sensordata: FloatArray, *, in_base: bool) -> tuple[FloatArray, FloatArray]:
        """Positions (..., b, 3), m, and quaternions (..., b, 4), w x y z, of the bodies, in the base or the world."""
        poses = sensordata[..., self._bodies_in_base if in_base else self._bodies]
        return poses[..., :3], poses[..., 3:]


def _pose(at: Mapping[str, slice], name: str) -> slice:
    first = at[f"{name}_position"].start
    return slice(first, first + 7)
