"""Height scans of the ground around a robot, by MuJoCo's rays.

The rays are rangefinders of a model that holds only the ground, on a body that is put where the robot's grid lies. So a
batch casts them in native threads, and a single robot by the same code with the same results.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.mit import BASE, IMU, FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import base_body, named_frame
from humanoid_sim.simulation.stance import DOWN, FLOOR_GROUP, fixed_geoms, floor_alone

_STEEP = 0.1
"""Length of an axis' horizontal part below which it has no heading."""
_DOWN = (0.0, 1.0, 0.0, 0.0)
"""Turns z downwards: a rangefinder measures along its site's z axis."""


class HeightScanner:
    """Scanner of everything that stands still and can be touched, except the robot. Not thread-safe."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription, scan: HeightScan) -> None:
        """Build the model of the ground. Raises `InputError` if the model lacks the frame in the grid's middle."""
        base, name = base_body(model, description), description.imu if scan.at == IMU else scan.at
        is_base = scan.at == BASE
        self.frame = (mujoco.mjtObj.mjOBJ_XBODY, base) if is_base else named_frame(model, name, "height scan")
        """Kind and id of the frame in the middle of the grid."""
        self._scan = scan
        self.model = _ground(model, base, scan)
        """Model of the ground, with one rangefinder per ray."""
        self._data = mujoco.MjData(self.model)

    def read(self, pose: FloatArray) -> FloatArray:
        """Scan around one pose (7,), m and w x y z, of the frame in the world: shape (rays,), m."""
        self._data.mocap_pos[0], self._data.mocap_quat[0] = np.split(self.place(pose), [3])
        mujoco.mj_forward(self.model, self._data)
        return self.heights(self._data.sensordata)

    def place(self, pose: FloatArray) -> FloatArray:
        """Return the level pose of the grid, shape (..., 7), for poses of its frame, shape (..., 7)."""
        w, x, y, z = np.moveaxis(pose[..., 3:], -1, 0)
        forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        # Where x points up or down, y tells the heading.
        leftward = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
        is_steep = np.hypot(*forward) < _STEEP
        yaw = np.where(is_steep, np.arctan2(-leftward[0], leftward[1]), np.arctan2(forward[1], forward[0]))
        level = np.zeros_like(pose)
        level[..., :3] = pose[..., :3]
        level[..., 3], level[..., 6] = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
        return level

    def heights(self, distance: FloatArray) -> FloatArray:
        """Return the values, shape (..., rays), m, for distances along the rays; negative ones hit nothing."""
        scan = self._scan
        is_hit = (distance >= 0.0) & (distance <= scan.range)
        return np.where(is_hit, distance - scan.above - scan.offset, scan.missed)


def _ground(model: mujoco.MjModel, robot: int, scan: HeightScan) -> mujoco.MjModel:
    """Build a model of the rays and the ground: the fixed geoms without those of the body `robot` and its subtree."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    spec = mujoco.MjSpec()
    for i in fixed_geoms(model):
        if model.body_rootid[model.geom_bodyid[i]] != robot:
            _add_geom(spec, model, data, i)
    carrier = spec.worldbody.add_body(mocap=True)
    for number, (x, y) in enumerate(scan.points.tolist()):
        name = f"ray {number}"
        carrier.add_site(name=name, pos=[x, y, scan.above], quat=_DOWN)
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_RANGEFINDER,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=name,
            intprm=[1 << int(mujoco.mjtRayDataField.mjRAYDATA_DIST), 0, 0],
        )
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return spec.compile()


def _add_geom(spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, i: int) -> None:
    """Add geom i where it is in the world."""
    quaternion, name, k = np.empty(4), f"geom {i}", int(model.geom_dataid[i])
    mujoco.mju_mat2Quat(quaternion, data.geom_xmat[i])
    kind = mujoco.mjtGeom(int(model.geom_type[i]))
    shape = {"size": model.geom_size[i]}
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        shape = {"size": np.array([0.0, 0.0, 1.0])}  # a plane's size is that of its picture
    elif kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        rows, columns, begin = int(model.hfield_nrow[k]), int(model.hfield_ncol[k]), int(model.hfield_adr[k])
        heights = model.hfield_data[begin : begin + rows * columns].tolist()
        spec.add_hfield(name=name, nrow=rows, ncol=columns, size=model.hfield_size[k], userdata=heights)
        shape = {"hfieldname": name}
    elif kind in (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF):
        kind = mujoco.mjtGeom.mjGEOM_MESH
        vertices, faces = (
            array[first : first + count].ravel()
            for array, first, count in (
                (model.mesh_vert, model.mesh_vertadr[k], model.mesh_vertnum[k]),
                (model.mesh_face, model.mesh_faceadr[k], model.mesh_facenum[k]),
            )
        )
        spec.add_mesh(name=name, uservert=vertices, userface=faces, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        shape = {"meshname": name}
    spec.worldbody.add_geom(type=kind, pos=data.geom_xpos[i], quat=quaternion, **shape)


class GroundScanner:
    """Casts the rays of N robots' grids on everything that stands still and can be touched, except the robot."""

    def __init__(self, model: mujoco.MjModel, robot: int, scan: HeightScan, count: int, threads: int) -> None:
        """Set up; `robot` is the id of the robot's base body, on `threads` in MuJoCo."""
        geoms = [i for i in fixed_geoms(model) if model.body_rootid[model.geom_bodyid[i]] != robot]
        self._ground = Batch(floor_alone(model, geoms), count, threads)
        self._scan = scan
        self._points = np.concatenate([scan.points, np.full((scan.count, 1), scan.above)], axis=1)

    def scan(self, pose: FloatArray) -> FloatArray:
        """Return the values, shape (..., rays), m, of grids around poses (..., 7), m and w x y z, world frame."""
        w, x, y, z = np.moveaxis(pose[..., 3:], -1, 0)
        forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        leftward = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
        is_steep = np.hypot(*forward) < _STEEP  # where x points up or down, y has the heading
        yaw = np.where(is_steep, np.arctan2(-leftward[0], leftward[1]), np.arctan2(forward[1], forward[0]))
        cos, sin = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
        px, py, pz = self._points.T
        origin = np.stack(
            [cos * px - sin * py, sin * px + cos * py, np.broadcast_to(pz, (*yaw.shape, len(pz)))], axis=-1
        )
        origin = (origin + pose[..., None, :3]).reshape(-1, len(px), 3)
        distance, _ = self._ground.ray(origin, DOWN, FLOOR_GROUP)
        distance = distance.reshape(*yaw.shape, len(px))
        is_hit = (distance >= 0.0) & (distance <= self._scan.range)
        return np.where(is_hit, distance - self._scan.above - self._scan.offset, self._scan.missed)
