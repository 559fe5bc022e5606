"""The robot as a tree of bodies and hinges: in what orders its joints and bodies may come, how they turn, where."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import base_body, breadth_first, build_model, joints_of

Orders = Mapping[str, tuple[str, ...]]
"""Orders of joints or bodies, by the name that --joint-order or --body-order knows them by."""


class Skeleton:
    """Names and geometry of a robot's bodies, in MJCF order, from the base on. One instance per thread."""

    def __init__(self, description: RobotDescription, contract: PolicyContract | None = None) -> None:
        """Build the model; a contract adds its orders to the robot's."""
        model = build_model(description, scene=False)
        base = base_body(model, description)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        by_level = breadth_first(model, base)
        depth_first = sorted(by_level)
        self.description = description
        self.base: str = model.body(base).name
        self.base_position: FloatArray = data.xpos[base].copy()
        """Shape (3,), m, world frame, where the model has it."""
        self.base_quaternion: FloatArray = data.xquat[base].copy()
        """Shape (4,), w x y z."""
        self.joints = description.joint_names
        self.bodies: tuple[str, ...] = tuple(model.body(body).name for body in depth_first)
        self.joint_orders: Orders = {
            **({} if contract is None else {"contract": contract.joint_names}),
            "robot": self.joints,
            "mjcf": joints_of(model, depth_first, self.joints),
            "breadth_first": joints_of(model, by_level, self.joints),
        }
        """The robot's joints in the policy's order, its description's, depth first as the MJCF and mjlab have them, or
        breadth first as Isaac does."""
        self.body_orders: Orders = {
            **({} if contract is None else {"contract": contract.body_names}),
            "mjcf": self.bodies,
            "breadth_first": tuple(model.body(body).name for body in by_level),
        }
        """All bodies in these orders, those of the policy in its own."""
        self._forward = ForwardKinematics(description, self.bodies)

    def poses(self, joint_position: FloatArray, bodies: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Return where joint positions (F, n), rad, put bodies, base frame: (F, B, 3), m, and (F, B, 3, 3)."""
        columns = [self.bodies.index(name) for name in bodies]
        position, rotation = self._forward(joint_position)
        return position[:, columns], rotation[:, columns]
