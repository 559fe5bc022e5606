"""The robot as a tree of bodies and hinges: in what orders its joints and bodies may come, how they turn, where."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import base_body, build_model

Orders = Mapping[str, tuple[str, ...]]
"""Orders of joints or bodies, by the name that --joint-order or --body-order knows them by."""


class Skeleton:
    """Names and geometry of a robot's bodies, in MJCF order, from the base on. One instance per thread."""

    def __init__(self, description: RobotDescription) -> None:
        """Build the model."""
        model = build_model(description, scene=False)
        base = base_body(model, description)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        depth = {base: 0}
        for body in range(base + 1, model.nbody):
            if int(model.body_parentid[body]) in depth:
                depth[body] = depth[int(model.body_parentid[body])] + 1
        # Among bodies of the same depth the children of the first come first: the MJCF's own order. The sort is stable.
        breadth_first = sorted(depth, key=lambda body: depth[body])
        self.description = description
        self.base: str = model.body(base).name
        self.base_position: FloatArray = data.xpos[base].copy()
        """Shape (3,), m, world frame, where the model has it."""
        self.base_quaternion: FloatArray = data.xquat[base].copy()
        """Shape (4,), w x y z."""
        self.joints = description.joint_names
        self.bodies: tuple[str, ...] = tuple(model.body(body).name for body in depth)
        self.joint_orders: Orders = {
            "robot": self.joints,
            "mjcf": self._joints_of(model, depth),
            "breadth_first": self._joints_of(model, breadth_first),
        }
        """The robot's joints in its description's order, depth first as the MJCF and mjlab have them, or breadth first
        as Isaac does."""
        self.body_orders: Orders = {
            "mjcf": self.bodies,
            "breadth_first": tuple(model.body(body).name for body in breadth_first),
        }
        """All bodies in these orders."""
        self._forward = ForwardKinematics(description, self.bodies)
        standing, _ = self._forward(np.array(description.initial_position)[None])
        self.height = max(float(self.base_position[2]), float(np.ptp(standing[0], axis=0).max()))
        """m, roughly: of the base above the ground, or from the robot's first body to its farthest."""

    def _joints_of(self, model: mujoco.MjModel, bodies: Iterable[int]) -> tuple[str, ...]:
        names = (model.joint(j).name for body in bodies for j in _joints(model, body))
        return tuple(name for name in names if name in self.joints)

    def poses(self, joint_position: FloatArray, bodies: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Return where joint positions (F, n), rad, put bodies, base frame: (F, B, 3), m, and (F, B, 3, 3)."""
        columns = [self.bodies.index(name) for name in bodies]
        position, rotation = self._forward(joint_position)
        return position[:, columns], rotation[:, columns]


def _joints(model: mujoco.MjModel, body: int) -> range:
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))
