"""The feet of a robot: points of their soles, and how fast these slide on the floor."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import rotate
from humanoid_sim.evaluation.step_metrics import length
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation.model import build_model, joint_addresses

_TOUCHING = 0.005  # m above the floor up to which a point touches: simulated contacts give by a millimetre or two
_STANDING = 0.03  # m above the lowest point of the standing robot up to which a body is a foot
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


class Feet:
    """Points of a robot's soles: corners of the boxes around its feet's geometry."""

    def __init__(self, description: RobotDescription) -> None:
        """Find the bodies that the robot stands on in its initial position: whose collision geometry is lowest."""
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
        low = {
            body: data.xpos[body][2] + rotate(data.xquat[body], np.array(of))[:, 2].min()
            for body, of in corners.items()
        }
        feet = [body for body in corners if low[body] < min(low.values()) + _STANDING]
        self.bodies = tuple(model.body(body).name for body in feet)
        self._foot = np.repeat(np.arange(len(feet)), [len(corners[body]) for body in feet])
        self._points = np.concatenate([corners[body] for body in feet])  # shape (P, 3), m, body frame
        self._floor = description.simulation.floor_height

    def place(self, position: FloatArray, quaternion: FloatArray) -> FloatArray:
        """Return the points in the world, shape (N, P, 3), m, by the bodies' poses: (N, F, 3), m, and (N, F, 4)."""
        placed: FloatArray = position[:, self._foot] + rotate(quaternion[:, self._foot], self._points)
        return placed

    def slip(self, before: FloatArray, after: FloatArray, period: float) -> FloatArray:
        """Return the mean speed of the points that touch the floor at both instants, shape (N,), m/s; NaN for none.

        Both are shape (N, P, 3), m, from `place`, `period` s apart.
        """
        touches = np.maximum(before[..., 2], after[..., 2]) < self._floor + _TOUCHING
        speed, count = length(after[..., :2] - before[..., :2]) / period, touches.sum(axis=-1)
        return np.where(count > 0, (speed * touches).sum(axis=-1) / np.maximum(count, 1), np.nan)
