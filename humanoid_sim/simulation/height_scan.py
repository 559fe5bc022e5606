"""Height scans of the ground around robots, by MuJoCo's rays."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco.batch import Batch

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.stance import DOWN, GROUND_GROUP, fixed_geoms, ground_model

_STEEP = 0.1  # length of an axis' horizontal part below which it has no heading


class HeightScanner:
    """Casts the rays of N robots' grids on everything that stands still and can be touched, except the robot."""

    def __init__(self, model: mujoco.MjModel, robot: int, scan: HeightScan, count: int, threads: int) -> None:
        """Find the ground; `robot` is the id of the robot's base body, `threads` cast the rays."""
        geoms = [i for i in fixed_geoms(model) if model.body_rootid[model.geom_bodyid[i]] != robot]
        self._ground = Batch(ground_model(model, geoms), count, threads)
        self._scan = scan
        self._points = scan.points

    def scan(self, pose: FloatArray) -> FloatArray:
        """Return the values, shape (..., rays), m, of level grids around poses (..., 7), m and w x y z, world frame."""
        w, x, y, z = np.moveaxis(pose[..., 3:], -1, 0)
        forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        leftward = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
        is_steep = np.hypot(*forward) < _STEEP  # where x points up or down, y has the heading
        yaw = np.where(is_steep, np.arctan2(-leftward[0], leftward[1]), np.arctan2(forward[1], forward[0]))
        cos, sin = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
        px, py = self._points.T
        turned = cos * px - sin * py, sin * px + cos * py, np.zeros((*yaw.shape, len(px)))
        origin = (np.stack(turned, axis=-1) + pose[..., None, :3]).reshape(-1, len(px), 3)
        distance = self._ground.ray(origin, DOWN, GROUND_GROUP)[0].reshape(*yaw.shape, len(px))
        is_hit = (distance >= 0.0) & (distance <= self._scan.range)
        return np.where(is_hit, distance - self._scan.offset, self._scan.range)
