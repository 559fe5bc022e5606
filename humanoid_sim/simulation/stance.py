"""Stance of a robot: the floor under it, and the height of its centre of mass above that."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

_FLAT = 1e-9
"""m, and 1: planes that differ by less in level and direction are one floor."""


class Floor:
    """Static parts of a model that can be touched: their level under any point. Not thread-safe."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find them."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        geoms = fixed_geoms(model)
        levels = data.geom_xpos[geoms, 2]
        is_plane = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_PLANE
        is_level = data.geom_xmat[geoms, 8] > 1.0 - _FLAT
        self._level: float | None = None
        """m, everywhere; None where it depends on the place."""
        if not geoms:
            self._level = 0.0
        elif (is_plane & is_level).all() and np.ptp(levels) < _FLAT:
            self._level = float(levels.max())
        else:
            self._cast = floor_alone(model, geoms)
            self._data = mujoco.MjData(self._cast)
            mujoco.mj_kinematics(self._cast, self._data)
            # Beyond the edge of a floor that has one, its own lowest part is what a robot sinks to.
            extents = np.where(is_plane, 0.0, model.geom_rbound[geoms])
            self._lowest = float((levels - extents).min())

    def level(self, position: FloatArray) -> FloatArray:
        """Shape (...), m, world frame: of the first thing straight below points of shape (..., 3), m."""
        if self._level is not None:
            return np.full(position.shape[:-1], self._level)
        points = position.reshape(-1, 3)
        levels = np.array([self._below(point) for point in points])
        return levels.reshape(position.shape[:-1])

    def _below(self, point: FloatArray) -> float:
        distance = mujoco.mj_ray(self._cast, self._data, point, DOWN, FLOOR_GROUP, True, -1, None)
        return self._lowest if distance < 0.0 else float(point[2]) - distance


def fixed_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the ids of the geoms that stand still and can be touched."""
    paired = {int(geom) for pair in (model.pair_geom1, model.pair_geom2) for geom in pair}
    return [
        i
        for i in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[i]] == 0
        and (model.geom_contype[i] or model.geom_conaffinity[i] or i in paired)
    ]


DOWN = np.array([0.0, 0.0, -1.0])
FLOOR_GROUP: npt.NDArray[np.uint8] = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)


def floor_alone(model: mujoco.MjModel, geoms: list[int]) -> mujoco.MjModel:
    """Give a model of which a ray of `FLOOR_GROUP` hits these geoms only: however they look, and planes everywhere."""
    model = copy.copy(model)
    model.geom_group[:] = 1
    model.geom_group[geoms] = 0
    model.geom_matid[geoms] = -1
    model.geom_rgba[geoms, 3] = 1.0
    planes = [i for i in geoms if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
    model.geom_size[planes, :2] = 0.0  # a plane's size is that of its picture
    return model


class CentreOfMass:
    """Centre of mass of a robot in any pose. Keeps its own `MjData`; not thread-safe."""

    def __init__(self, model: mujoco.MjModel, body: str) -> None:
        """Find the geoms of `body` and of all that hangs on it."""
        self._model, self._data = model, mujoco.MjData(model)
        self._body = int(model.body(body).id)

    def __call__(self, qpos: FloatArray) -> FloatArray:
        """Shape (3,), m, world frame, at MuJoCo's generalised position (nq,); a copy."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        position: FloatArray = self._data.subtree_com[self._body].copy()
        return position


def standing_height(model: mujoco.MjModel, body: str, qpos: FloatArray) -> float:
    """m, of the robot's centre of mass above the floor if it stood there in this pose, qpos of shape (nq,).

    However high above the floor it hangs: its lowest part is taken to touch the floor.
    """
    position = CentreOfMass(model, body)(qpos)
    return float(position[2] - Floor(model).level(position)) - clearance(model, qpos)


def clearance(model: mujoco.MjModel, qpos: FloatArray) -> float:
    """m, from the lowest part of the robot that can collide down to what stands still; 0 if there is nothing below."""
    model = copy.copy(model)
    is_static = model.body_weldid[model.geom_bodyid] == 0
    # Contacts are found within a margin: one as large as the robot finds them however far it floats or is sunk in.
    far = 10.0 + 4.0 * float(model.stat.extent)
    model.geom_margin[is_static] = far
    model.pair_margin[:] = far  # feet may touch the floor through explicit contact pairs, with margins of their own
    # Bodies of several geoms are sorted out by margins that were taken when the model was compiled.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    pairs = data.contact.geom
    distances = data.contact.dist[is_static[pairs].any(axis=1)] if len(pairs) else np.empty(0)
    return float(distances.min()) if len(distances) else 0.0
