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

_TOUCHING = 0.005  # m above the floor up to which a point touches: simulated contacts give by a millimetre or two
_STANDING = 0.03  # m above the lowest point of the standing robot up to which a body is a foot
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True, slots=True, eq=False)
class Feet:
    """Points of a robot's soles: corners of the boxes around its feet's geometry."""

    bodies: tuple[str, ...]
    """MJCF bodies, one per foot."""
    foot: tuple[int, ...]
    """Index into `bodies` of each of the P points."""
    points: FloatArray
    """Shape (P, 3), m, body frame."""
    floor: float
    """m, height of the floor."""

    def place(self, position: FloatArray, quaternion: FloatArray) -> FloatArray:
        """Return the points in the world, shape (N, P, 3), m, by the bodies' poses: (N, F, 3), m, and (N, F, 4)."""
        foot = list(self.foot)
        placed: FloatArray = position[:, foot] + rotate(quaternion[:, foot], self.points)
        return placed

    def slip(self, before: FloatArray, after: FloatArray, period: float) -> FloatArray:
        """Return the mean speed of the points that touch the floor at both instants, shape (N,), m/s; NaN for none.

        Both are shape (N, P, 3), m, from `place`, `period` s apart.
        """
        touching = (np.maximum(before[..., 2], after[..., 2]) < self.floor + _TOUCHING).astype(np.float64)
        step = after[..., :2] - before[..., :2]
        speed = np.sqrt((step * step).sum(axis=-1)) / period
        count = touching.sum(axis=-1)
        return np.where(count > 0, (speed * touching).sum(axis=-1) / np.maximum(count, 1), np.nan)


def find_feet(description: RobotDescription) -> Feet:
    """Return the bodies that the robot stands on in its initial position: those whose collision geometry is lowest."""
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    data.qpos[joint_addresses(model, description.joint_names).qpos] = description.initial_position
    mujoco.mj_kinematics(model, data)
    points: dict[int, list[FloatArray]] = {}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        if model.body_weldid[body] and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            axes, box = np.zeros(9), model.geom_aabb[geom]
            mujoco.mju_quat2Mat(axes, model.geom_quat[geom])
            corners = model.geom_pos[geom] + (box[:3] + _CORNERS * box[3:]) @ axes.reshape(3, 3).T
            points.setdefault(body, []).extend(corners)
    height = {body: min((data.xmat[body].reshape(3, 3) @ p)[2] for p in found) for body, found in points.items()}
    lowest = {body: data.xpos[body][2] + below for body, below in height.items()}
    bodies = [body for body, low in lowest.items() if low < min(lowest.values()) + _STANDING]
    return Feet(
        bodies=tuple(model.body(body).name for body in bodies),
        foot=tuple(i for i, body in enumerate(bodies) for _ in points[body]),
        points=np.array([point for body in bodies for point in points[body]]).reshape(-1, 3),
        floor=description.simulation.floor_height,
    )
