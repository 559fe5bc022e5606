"""Meaning of a motion's columns: what the source says, else the options; assumed only where kinematics can confirm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rotation import conjugate, multiply, quaternion_from_matrix, rotate, seen_from
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare import PrepareOptions
from humanoid_sim.prepare.sources import SourceMotion
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import base_body, breadth_first, build_model, joints_of


class Skeleton:
    """Names and geometry of a robot's bodies, from the base on, and the orders in which motions have them."""

    def __init__(self, description: RobotDescription, contract: PolicyContract) -> None:
        model = build_model(description, scene=False)
        base = base_body(model, description)
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        by_level = breadth_first(model, base)
        self.description = description
        self.base: str = model.body(base).name
        self.base_pose: FloatArray = np.concatenate([data.xpos[base], data.xquat[base]])
        """Shape (7,), m and w x y z, world frame, where the model has it."""
        self.joints = description.joint_names
        self.bodies: tuple[str, ...] = tuple(model.body(body).name for body in sorted(by_level))
        self.joint_orders = {
            "contract": contract.joint_names,
            "robot": self.joints,
            "mjcf": joints_of(model, sorted(by_level), self.joints),
            "breadth_first": joints_of(model, by_level, self.joints),
        }
        self.body_orders = {
            "contract": contract.body_names,
            "mjcf": self.bodies,
            "breadth_first": tuple(model.body(body).name for body in by_level),
        }
        self._forward = ForwardKinematics(description, self.bodies)

    def poses(self, joints: FloatArray, bodies: tuple[str, ...]) -> FloatArray:
        """Return where joint positions (F, n), rad, put bodies: (F, B, 7), m and w x y z, base frame."""
        columns = [self.bodies.index(name) for name in bodies]
        position, rotation = self._forward(joints)
        return np.concatenate([position[:, columns], quaternion_from_matrix(rotation[:, columns])], axis=-1)


def interpret(
    source: SourceMotion, skeleton: Skeleton, options: PrepareOptions
) -> tuple[SourceMotion, tuple[str, ...]]:
    """Return the motion as the robot has it, and the options that were assumed.

    Joints are in the robot's order, rad; quaternions w x y z; bodies in the base frame. The pose of the base is that of
    its body where the motion has it. Raises `InputError` where something is not known, or fits no body or joint.
    """
    assumed: list[str] = []

    def settle(option: str, own: str | tuple[str, ...] | None, given: str | None, usual: str) -> str:
        known = ",".join(own) if isinstance(own, tuple) else own
        if known is not None and given not in (None, known):
            raise InputError(f"{option}: is {given}, but {source.source} says {known}")
        if known is None and given is None:
            if source.bodies is None:
                reason = f"{source.source} does not say, and has no body poses that would show a mistake"
                raise InputError(f"{option}: is missing; {reason}")
            assumed.append(f"{option} {usual}")
        return known or given or usual

    joints, velocity = source.joints, source.joint_velocity
    if joints is not None:
        order = settle("--joint-order", source.joint_names, options.joint_order, "contract")
        names = _named(source, "joint", order, skeleton.joint_orders, joints.shape[1], skeleton.joints)
        require_known("joint", skeleton.joints, names, f"{source.source}: ")
        columns = [names.index(joint) for joint in skeleton.joints]
        is_degrees = settle("--angle-unit", source.angle_unit, options.angle_unit, "rad") == "deg"
        scale = math.radians(1.0) if is_degrees else 1.0
        joints = scale * joints[:, columns]
        velocity = None if velocity is None else scale * velocity[:, columns]
    bodies: tuple[str, ...] = ()
    if source.bodies is not None:
        count = source.bodies.shape[1]
        usual = "contract" if count == len(skeleton.body_orders["contract"]) else "mjcf"
        order = settle("--body-order", source.body_names, options.body_order, usual)
        bodies = _named(source, "body", order, skeleton.body_orders, count, skeleton.bodies)
    turned: dict[str, Any] = {}
    for name in ("base", "bodies"):
        pose = getattr(source, name)
        if pose is not None:
            order = settle("--quaternions", source.quaternion_order, options.quaternions, "wxyz")
            quaternion = np.roll(pose[..., 3:], 1, axis=-1) if order == "xyzw" else pose[..., 3:]
            quaternion = quaternion / np.sqrt((quaternion**2).sum(axis=-1, keepdims=True))
            turned[name] = np.concatenate([pose[..., :3], quaternion], axis=-1)
    motion = replace(
        source,
        joints=joints,
        joint_velocity=velocity,
        joint_names=skeleton.joints,
        body_names=bodies,
        quaternion_order="wxyz",
        angle_unit="rad",
        **turned,
    )
    return _in_base_frame(motion, skeleton, bodies), tuple(dict.fromkeys(assumed))


def _named(
    source: SourceMotion,
    what: str,
    order: str,
    orders: Mapping[str, tuple[str, ...]],
    count: int,
    known: tuple[str, ...],
) -> tuple[str, ...]:
    """Return the names of the columns of joints or bodies: of a known order, or those given with commas."""
    names = orders.get(order) or tuple(name.strip() for name in order.split(","))
    if len(names) != count:
        counts = ", ".join(f"{name} ({len(listed)})" for name, listed in orders.items())
        found = f"--{what}-order: {order} has {len(names)} names, and {source.source} {count} columns"
        raise InputError(f"{found}; expected one of {counts}, or names with commas")
    require_known(what, names, known, f"{source.source}: ")
    return names


def _in_base_frame(motion: SourceMotion, skeleton: Skeleton, names: tuple[str, ...]) -> SourceMotion:
    """Return the motion with its bodies in the frame of the base, and the base's own pose in the world."""
    base, bodies = motion.base, motion.bodies if motion.frame == "world" else None
    if bodies is not None and skeleton.base in names:
        base = bodies[:, names.index(skeleton.base)]
    elif base is None and not skeleton.description.is_floating:
        fixed = skeleton.base_pose
        if bodies is not None and motion.joints is not None:
            # A base that does not move is where the first body of the first frame puts it.
            seen, first = skeleton.poses(motion.joints[:1], names[:1])[0, 0], bodies[0, 0]
            turn = multiply(first[3:], conjugate(seen[3:]))
            fixed = np.concatenate([first[:3] - rotate(turn, seen[:3]), turn])
        base = np.repeat(fixed[None], len(motion.times), axis=0)
    if bodies is None:
        return replace(motion, base=base)
    if base is None:
        raise InputError(f"{motion.source}: has no pose of the floating base '{skeleton.base}', which is needed")
    relative = seen_from(base[:, :3], base[:, 3:], bodies[..., :3], bodies[..., 3:])
    return replace(motion, base=base, bodies=np.concatenate(relative, axis=-1), frame="base")
