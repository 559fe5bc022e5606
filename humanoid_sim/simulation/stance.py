"""The ground that a robot stands on, and how far above it the robot is."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

DOWN = np.array([0.0, 0.0, -1.0])
GROUND_GROUP: npt.NDArray[np.uint8] = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
"""The groups that a ray on a `ground_model` may hit."""


def fixed_geoms(model: mujoco.MjModel) -> list[int]:
    """Return the ids of the geoms that stand still and can be touched."""
    paired = np.isin(np.arange(model.ngeom), [*model.pair_geom1, *model.pair_geom2])
    touchable = (model.geom_contype != 0) | (model.geom_conaffinity != 0) | paired
    found: list[int] = np.flatnonzero(touchable & (model.body_weldid[model.geom_bodyid] == 0)).tolist()
    return found


def ground_model(model: mujoco.MjModel, geoms: Sequence[int]) -> mujoco.MjModel:
    """Return a model of which rays of `GROUND_GROUP` hit these geoms only, visible or not, and planes everywhere."""
    model = copy.copy(model)
    model.geom_group[:] = 1
    model.geom_group[geoms] = 0
    model.geom_matid[geoms] = -1
    model.geom_rgba[geoms, 3] = 1.0
    planes = [i for i in geoms if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
    model.geom_size[planes, :2] = 0.0  # a plane's size is that of its picture
    return model


class Floor:
    """Level of the ground under any point. Not thread-safe."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the ground; one level plane needs no rays."""
        geoms = fixed_geoms(model)
        self._ground = ground_model(model, geoms)
        self._data = mujoco.MjData(self._ground)
        mujoco.mj_kinematics(self._ground, self._data)
        self._lowest = float(self._data.geom_xpos[geoms, 2].min()) if geoms else 0.0
        is_plane = len(geoms) == 1 and model.geom_type[geoms[0]] == mujoco.mjtGeom.mjGEOM_PLANE
        self._is_flat = not geoms or bool(is_plane and self._data.geom_xmat[geoms[0], 8] > 1.0 - 1e-9)

    def level(self, position: FloatArray) -> FloatArray:
        """Return the level of the first thing straight below points of shape (..., 3), m, world frame: (...), m."""
        if self._is_flat:
            return np.full(position.shape[:-1], self._lowest)
        levels = np.array([self._below(point) for point in position.reshape(-1, 3)])
        return levels.reshape(position.shape[:-1])

    def _below(self, point: FloatArray) -> float:
        distance = mujoco.mj_ray(self._ground, self._data, point, DOWN, GROUND_GROUP, True, -1, None)
        return self._lowest if distance < 0.0 else float(point[2]) - distance


def clearance(model: mujoco.MjModel, qpos: FloatArray) -> float:
    """Return m from the lowest part of the robot that can collide down to the ground; 0 if nothing is below."""
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
    on_ground = is_static[data.contact.geom].any(axis=1) if data.ncon else np.zeros(0, dtype=bool)
    return float(data.contact.dist[on_ground].min()) if on_ground.any() else 0.0
