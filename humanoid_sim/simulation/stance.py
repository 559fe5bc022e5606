"""Stance of a robot: the floor under it, and the height of its centre of mass above that."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.mjcf import mujoco_silenced

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
        self._field = _Field.of(model, data, geoms)
        if not geoms:
            self._level = 0.0
        elif (is_plane & is_level).all() and np.ptp(levels) < _FLAT:
            self._level = float(levels.max())
        elif self._field is None:
            self._cast = _floor_alone(model, geoms)
            self._data = mujoco.MjData(self._cast)
            mujoco.mj_kinematics(self._cast, self._data)
            # Beyond the edge of a floor that has one, its own lowest part is what a robot sinks to.
            extents = np.where(is_plane, 0.0, model.geom_rbound[geoms])
            self._lowest = float((levels - extents).min())

    def level(self, position: FloatArray) -> FloatArray:
        """Shape (...), m, world frame: of the first thing straight below points of shape (..., 3), m."""
        if self._level is not None:
            return np.full(position.shape[:-1], self._level)
        if self._field is not None:
            return self._field.level(position)
        points = position.reshape(-1, 3)
        levels = np.array([self._below(point) for point in points])
        return levels.reshape(position.shape[:-1])

    def _below(self, point: FloatArray) -> float:
        distance = mujoco.mj_ray(self._cast, self._data, point, _DOWN, _FLOOR_GROUP, True, -1, None)
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


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """A height field with flat ground around it, whose level many points can be told at once."""

    heights: FloatArray
    """Shape (rows along y, columns along x), m, world frame."""
    middle: FloatArray
    """Shape (2,), m, world frame."""
    half: FloatArray
    """Shape (2,), m, half of its length along x and y."""
    around: float
    """m, world frame: how high the ground beside it is."""

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int]) -> _Field | None:
        """Return the only height field among geoms, if not turned and with level boxes beside it; else None."""
        fields = [i for i in geoms if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_HFIELD]
        boxes = [i for i in geoms if i not in fields]
        if len(fields) != 1 or not boxes:
            return None
        (field,), k = fields, model.geom_dataid[fields[0]]
        rows, columns, begin = model.hfield_nrow[k], model.hfield_ncol[k], model.hfield_adr[k]
        x, y, z, _ = model.hfield_size[k]
        middle, half = data.geom_xpos[field, :2].copy(), np.array([x, y])
        sizes = model.geom_size[boxes]
        levels = data.geom_xpos[boxes, 2] + sizes[:, 2]
        is_beside = (np.abs(data.geom_xpos[boxes, :2] - middle) + _FLAT >= half + sizes[:, :2]).any(axis=1)
        is_box = model.geom_type[boxes] == mujoco.mjtGeom.mjGEOM_BOX
        are_straight = np.abs(data.geom_xmat[geoms] - np.eye(3).ravel()).max() < _FLAT
        if not (is_box.all() and is_beside.all() and are_straight and np.ptp(levels) < _FLAT):
            return None
        shares = model.hfield_data[begin : begin + rows * columns].reshape(rows, columns).astype(np.float64)
        return cls(data.geom_xpos[field, 2] + z * shares, middle, half, float(levels[0]))

    def level(self, position: FloatArray) -> FloatArray:
        """See `Floor.level`. MuJoCo cuts each cell into two triangles, along the diagonal of rising x and y."""
        rows, columns = self.heights.shape
        place = (position[..., :2] - self.middle + self.half) / (2.0 * self.half) * [columns - 1, rows - 1]
        is_on = ((place >= 0.0) & (place <= [columns - 1, rows - 1])).all(axis=-1)
        place = np.where(is_on[..., None], place, 0.0)
        column, row = (np.minimum(place[..., i].astype(np.intp), n - 2) for i, n in ((0, columns), (1, rows)))
        x, y = place[..., 0] - column, place[..., 1] - row
        first, last = self.heights[row, column], self.heights[row + 1, column + 1]
        ahead, beside = self.heights[row, column + 1], self.heights[row + 1, column]
        below = first + x * (ahead - first) + y * (last - ahead)
        above = first + y * (beside - first) + x * (last - beside)
        return np.where(is_on, np.where(x >= y, below, above), self.around)


_DOWN = np.array([0.0, 0.0, -1.0])
_FLOOR_GROUP: npt.NDArray[np.uint8] = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)


def _floor_alone(model: mujoco.MjModel, geoms: list[int]) -> mujoco.MjModel:
    """Give a model of which a ray of `_FLOOR_GROUP` hits these geoms only: however they look, and planes everywhere."""
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
    with mujoco_silenced:  # of contacts beyond the arena's size those that fit are enough
        mujoco.mj_collision(model, data)
    pairs = data.contact.geom
    distances = data.contact.dist[is_static[pairs].any(axis=1)] if len(pairs) else np.empty(0)
    return float(distances.min()) if len(distances) else 0.0
