"""The feet of a robot: points of their soles, and how fast these slide on the floor."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

_TOUCHING = 0.005
"""m above the floor up to which a point touches: simulated contacts give by a millimetre or two."""
_STANDING = 0.03
"""m above the lowest point of the standing robot up to which a body is a foot."""
_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE)


@dataclass(frozen=True, slots=True, eq=False)
class Feet:
    """Points of a robot's soles."""

    bodies: tuple[str, ...]
    """MJCF bodies, one per foot."""
    foot: tuple[int, ...]
    """Index into `bodies` of each of the P points."""
    points: FloatArray
    """Shape (P, 3), m, body frame."""
    radius: FloatArray
    """Shape (P,), m: of round feet the point is a centre, and the sole this much below it."""
    floor: float
    """m, height of the floor."""
    sole: FloatArray
    """Shape (F,), m, from each body's origin down to its sole where the robot stands."""
    up: FloatArray
    """Shape (F, 3), body frame: the axis that is vertical where the robot stands."""
    base_height: float
    """m, of the base's origin above the soles where the robot stands."""

    def place(self, position: FloatArray, quaternion: FloatArray) -> FloatArray:
        """Return the points in the world, shape (N, P, 3), m, by the bodies' poses: (N, F, 3), m, and (N, F, 4)."""
        foot = list(self.foot)
        placed: FloatArray = position[:, foot] + rotate(quaternion[:, foot], self.points)
        return placed

    def slip(self, before: FloatArray, after: FloatArray, period: float) -> FloatArray:
        """Return the mean speed of the points that touch the floor at both instants, shape (N,), m/s; NaN for none.

        Both are shape (N, P, 3), m, from `place`, `period` s apart.
        """
        ground = self.floor + self.radius + _TOUCHING
        touching = (before[..., 2] < ground) & (after[..., 2] < ground)
        step = after[..., :2] - before[..., :2]
        speed = np.sqrt((step * step).sum(axis=-1)) / period
        count = touching.sum(axis=-1)
        mean: FloatArray = np.where(count > 0, (speed * touching).sum(axis=-1) / np.maximum(count, 1), np.nan)
        return mean


def find_feet(description: RobotDescription) -> Feet:
    """Return the bodies that the robot stands on in its initial position: those whose collision geometry is lowest."""
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    data.qpos[joint_addresses(model, description.joint_names).qpos] = description.initial_position
    mujoco.mj_kinematics(model, data)
    points: dict[int, list[tuple[FloatArray, float]]] = {}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if model.body_weldid[body] and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            points.setdefault(body, []).extend(_geom_points(model, geom))
    rotation = data.xmat.reshape(-1, 3, 3)
    depth = {body: max(radius - (rotation[body] @ p)[2] for p, radius in found) for body, found in points.items()}
    lowest = min((data.xpos[body][2] - below for body, below in depth.items()), default=0.0)
    bodies = [body for body, below in depth.items() if data.xpos[body][2] - below < lowest + _STANDING]
    chosen = [(i, point, radius) for i, body in enumerate(bodies) for point, radius in points[body]]
    base = data.body(description.base.body).xpos[2] if description.is_floating else 0.0
    return Feet(
        bodies=tuple(model.body(body).name for body in bodies),
        foot=tuple(i for i, _, _ in chosen),
        points=np.array([point for _, point, _ in chosen]).reshape(-1, 3),
        radius=np.array([radius for _, _, radius in chosen]),
        floor=description.simulation.floor_height,
        sole=np.array([depth[body] for body in bodies]),
        up=rotation[bodies, 2].reshape(-1, 3),
        base_height=float(base - lowest),
    )


def _geom_points(model: mujoco.MjModel, geom: int) -> list[tuple[FloatArray, float]]:
    """Return points of a geometry, body frame, and the radius about them: a bounding box unless it is round."""
    origin, matrix = model.geom_pos[geom], np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    axes = matrix.reshape(3, 3)
    size = model.geom_size[geom]
    kind = model.geom_type[geom]
    if kind in _ROUND:
        ends = (0.0,) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else (-size[1], size[1])
        return [(origin + axes @ np.array([0.0, 0.0, end]), float(size[0])) for end in ends]
    box = model.geom_aabb[geom]
    corners = (box[:3] + np.array(signs) * box[3:] for signs in product((-1.0, 1.0), repeat=3))
    return [(origin + axes @ corner, 0.0) for corner in corners]
