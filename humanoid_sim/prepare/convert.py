"""From a motion as its source has it to a motion file: as the robot has it, at the policy's rate, in its layout."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rotation import (
    conjugate,
    continuous,
    matrix,
    multiply,
    quaternion_from_matrix,
    rotate,
    seen_from,
    slerp,
)
from humanoid_sim.errors import InputError, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.motion import Motion, body_frames
from humanoid_sim.prepare import PrepareOptions
from humanoid_sim.prepare.sources import SourceMotion, derivative, require_each
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import base_body, breadth_first, build_model, joints_of

_OFF_RATE = 0.1  # share of a policy step by which a frame's time may be off


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
    """Return the motion in the robot's order, w x y z, bodies in the base frame, and the options that were assumed.

    Raises `InputError` where something is not known, or fits no body or joint.
    """
    assumed: list[str] = []

    def settle(option: str, own: str | None, given: str | None, usual: str) -> str:
        """Return what the source says, else the option, else the usual, which bodies must confirm."""
        if own is None and given is None:
            if source.bodies is None:
                raise InputError(f"{option}: is missing; no body poses of {source.source} would show a mistake")
            assumed.append(f"{option} {usual}")
        if own is not None and given not in (None, own):
            raise InputError(f"{option}: is given, but {source.source} says it itself")
        return own or given or usual

    changed: dict[str, Any] = {}
    bodies: tuple[str, ...] = ()
    if source.joints is not None:
        own = None if source.joint_names is None else ",".join(source.joint_names)
        order = settle("--joint-order", own, options.joint_order, "contract")
        names = _named(source.source, "joint", order, skeleton.joint_orders, source.joints.shape[1])
        require_each(source.source, skeleton.joints, names)
        columns = [names.index(joint) for joint in skeleton.joints]
        unit = math.radians(1.0) if options.degrees else 1.0
        for name in {"joints", "joint_velocity"} & source.arrays().keys():
            changed[name] = unit * source.arrays()[name][:, columns]
    if source.bodies is not None:
        count = source.bodies.shape[1]
        own = None if source.body_names is None else ",".join(source.body_names)
        usual = "contract" if count == len(skeleton.body_orders["contract"]) else "mjcf"
        order = settle("--body-order", own, options.body_order, usual)
        bodies = _named(source.source, "body", order, skeleton.body_orders, count)
    for name in ("base", "bodies"):
        pose = source.arrays().get(name)
        if pose is not None:
            order = settle("--quaternions", source.quaternion_order, options.quaternions, "wxyz")
            quaternion = np.roll(pose[..., 3:], 1, axis=-1) if order == "xyzw" else pose[..., 3:]
            quaternion = quaternion / np.sqrt((quaternion**2).sum(axis=-1, keepdims=True))
            changed[name] = np.concatenate([pose[..., :3], quaternion], axis=-1)
    motion = replace(source, joint_names=skeleton.joints, body_names=bodies, quaternion_order="wxyz", **changed)
    return _in_base_frame(motion, skeleton, bodies), tuple(dict.fromkeys(assumed))


def _named(source: str, what: str, order: str, orders: Mapping[str, tuple[str, ...]], count: int) -> tuple[str, ...]:
    """Return the names in an order, which are some of the robot's own in `mjcf` order."""
    names = orders.get(order) or tuple(name.strip() for name in order.split(","))
    if len(names) != count:
        found = f"--{what}-order: {order} has {len(names)} names, and {source} {count} columns"
        raise InputError(f"{found}; expected {', '.join(orders)}, or names with commas")
    require_known(what, names, orders["mjcf"], f"{source}: ")
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


def at_rate(motion: SourceMotion, policy_dt: float, *, resample: bool) -> SourceMotion:
    """Return the motion with a frame every `policy_dt` s; one of another rate is interpolated, or refused."""
    times = motion.times - motion.times[0]
    if np.abs(times - policy_dt * np.arange(len(times))).max() <= _OFF_RATE * policy_dt:
        return motion
    if not resample:
        rates = f"{motion.rate:.4g} frames per second, the policy takes {1.0 / policy_dt:g}"
        raise InputError(f"{motion.source}: has {rates} evenly spaced steps; add --resample to interpolate")
    count = int(times[-1] / policy_dt + 1e-6) + 1  # the last frame stays where only rounding is in the way
    place = np.minimum(policy_dt * np.arange(count), times[-1])
    upper = np.clip(np.searchsorted(times, place, side="right"), 1, len(times) - 1)
    lower = upper - 1
    weight = (place - times[lower]) / (times[upper] - times[lower])
    mixed: dict[str, Any] = {}
    for name, array in motion.arrays().items():
        w = weight.reshape(-1, *[1] * (array.ndim - 1))
        mixed[name] = (1.0 - w) * array[lower] + w * array[upper]
        if name in ("base", "bodies"):
            mixed[name][..., 3:] = slerp(array[lower][..., 3:], array[upper][..., 3:], w)
    return replace(motion, times=place, **mixed)


def convert(motion: SourceMotion, contract: PolicyContract, skeleton: Skeleton) -> Motion:
    """Return the content of a motion file: `bodies_b` for policies that observe bodies in the base frame.

    Else `joints_bodies_w`, for those with anchor terms. Raises `InputError` if the motion lacks what the layout needs.
    """
    names = contract.body_names or ((contract.anchor_body,) if contract.anchor_body else ())
    own, bodies, joints = motion.body_names or (), motion.bodies, motion.joints
    if bodies is not None and set(names) <= set(own):
        bodies = bodies[:, [own.index(name) for name in names]]
    elif joints is not None:
        bodies = skeleton.poses(joints, names)
    else:
        bodies = None
    in_base_frame = contract.requires("body_names")
    if bodies is None or (joints is None and not in_base_frame):
        raise InputError(f"{motion.source}: lacks joint positions, or bodies of {', '.join(names)}, which are needed")
    if joints is None or in_base_frame:
        frames = body_frames(bodies[..., :3], matrix(bodies[..., 3:]))
    elif motion.base is None:
        raise InputError(f"{motion.source}: has no pose of the floating base '{skeleton.base}', which is needed")
    else:
        turn = np.broadcast_to(motion.base[:, None, 3:], bodies[..., 3:].shape)
        position = rotate(turn, bodies[..., :3]) + motion.base[:, None, :3]
        quaternion = continuous(multiply(turn, bodies[..., 3:]))
        velocity = derivative(joints, motion.times) if motion.joint_velocity is None else motion.joint_velocity
        order = [skeleton.joints.index(joint) for joint in contract.joint_names]
        parts = (joints[:, order], velocity[:, order], position, quaternion)
        frames = np.concatenate([part.reshape(len(joints), -1) for part in parts], axis=1)
    return Motion(
        frames=frames.astype(np.float32),
        body_names=names,
        policy_dt=contract.policy_dt,
        task_type=contract.task_type,
        robot=skeleton.description.name,
        layout="bodies_b" if in_base_frame else "joints_bodies_w",
        joint_names=() if in_base_frame else contract.joint_names,
    )
