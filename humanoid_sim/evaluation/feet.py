"""The feet of a robot: points of their soles, and how fast these slide on the floor."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.evaluation.failure import length
from humanoid_sim.mit import FloatArray, IndexArray
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

_TOUCHING = 0.005  # m above the floor up to which a point touches: simulated contacts give by a millimetre or two
_STANDING = 0.03  # m above the lowest point of the standing robot up to which a body is a foot
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


@dataclass(frozen=True, slots=True, eq=False)
class Feet:
    """Points of a robot's soles: corners of the boxes around its feet's geometry."""

    bodies: tuple[str, ...]  # MJCF bodies, one per foot
    foot: IndexArray  # shape (P,), index into `bodies` of each point
    points: FloatArray  # shape (P, 3), m, body frame
    floor: float  # m, height of the floor

    def place(self, position: FloatArray, quaternion: FloatArray) -> FloatArray:
        """Return the points in the world, shape (N, P, 3), m, by the bodies' poses: (N, F, 3), m, and (N, F, 4)."""
        placed: FloatArray = position[:, self.foot] + rotate(quaternion[:, self.foot], self.points)
        return placed

    def slip(self, before: FloatArray, after: FloatArray, period: float) -> FloatArray:
        """Return the mean speed of the points that touch the floor at both instants, shape (N,), m/s; NaN for none.

        Both are shape (N, P, 3), m, from `place`, `period` s apart.
        """
        touches = np.maximum(before[..., 2], after[..., 2]) < self.floor + _TOUCHING
        speed, count = length(after[..., :2] - before[..., :2]) / period, touches.sum(axis=-1)
        return np.where(count > 0, (speed * touches).sum(axis=-1) / np.maximum(count, 1), np.nan)


def find_feet(description: RobotDescription) -> Feet:
    """Return the bodies that the robot stands on in its initial position: those whose collision geometry is lowest."""
    model = build_model(description, scene=False)
    data = mujoco.MjData(model)
    data.qpos[joint_addresses(model, description.joint_names).qpos] = description.initial_position
    mujoco.mj_kinematics(model, data)
    corners: dict[int, list[FloatArray]] = {}
    for geom in range(model.ngeom):
        body, box = int(model.geom_bodyid[geom]), model.geom_aabb[geom]
        if model.body_weldid[body] and (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            placed = rotate(model.geom_quat[geom], box[:3] + _CORNERS * box[3:])
            corners.setdefault(body, []).extend(model.geom_pos[geom] + placed)
    points = {body: np.array(found) for body, found in corners.items()}
    lowest = {body: data.xpos[body][2] + rotate(data.xquat[body], points[body])[:, 2].min() for body in points}
    bodies = [body for body, low in lowest.items() if low < min(lowest.values()) + _STANDING]
    return Feet(
        bodies=tuple(model.body(body).name for body in bodies),
        foot=np.repeat(np.arange(len(bodies)), [len(points[body]) for body in bodies]),
        points=np.concatenate([points[body] for body in bodies]),
        floor=description.simulation.floor_height,
    )
