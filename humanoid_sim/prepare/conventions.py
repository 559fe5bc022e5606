"""Meaning of a motion's columns, joint by joint and body by body: written down, then applied."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from humanoid_sim.controllers.terms import QuaternionOrder
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare import PrepareOptions
from humanoid_sim.prepare.skeleton import Orders, Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, swap_quaternion_order


@dataclass(frozen=True, slots=True)
class Conventions:
    """Meaning of a motion's columns."""

    joint_names: tuple[str, ...]
    """Names of the joint columns; empty if there are none."""
    body_names: tuple[str, ...]
    """Names of the bodies; empty if there are none."""
    quaternions: QuaternionOrder
    angle_unit: Literal["rad", "deg"] = "rad"
    """Unit of joint positions and velocities."""
    joints_said_by: str = ""
    """Origin of `joint_names`, for the report."""
    bodies_said_by: str = ""
    quaternions_said_by: str = ""


def choose_conventions(source: SourceMotion, skeleton: Skeleton, options: PrepareOptions) -> Conventions:
    """Return what the source says, else what the options say, else what the format is known to do.

    Raises `InputError` if an option contradicts names in the source, or a number of columns fits no order.
    """
    positions, usual = source.joint_position, "robot" if source.kind.startswith("csv") else "contract"
    orders, option = skeleton.joint_orders, options.joint_order
    joints, joints_by = _columns(source, "joint", positions, source.joint_names, orders, option, usual)
    positions, orders, option = source.body_position, skeleton.body_orders, options.body_order
    usual = "contract" if positions is not None and positions.shape[1] == len(orders["contract"]) else "mjcf"
    bodies, bodies_by = _columns(source, "body", positions, source.body_names, orders, option, usual)
    order, order_by, given = source.quaternion_order, source.quaternion_order_source, options.quaternions
    if given is not None and order_by != "column names":
        order, order_by = given, "--quaternions"
    elif given not in (None, order):
        raise InputError(f"--quaternions: is {given}, but the column names of {source.source} say which is which")
    return Conventions(
        joint_names=joints,
        body_names=bodies,
        quaternions=order,
        angle_unit=options.angle_unit,
        joints_said_by=joints_by,
        bodies_said_by=bodies_by,
        quaternions_said_by=order_by,
    )


def _columns(
    source: SourceMotion,
    what: Literal["joint", "body"],
    array: FloatArray | None,
    own: tuple[str, ...] | None,
    orders: Orders,
    option: str | None,
    usual: str,
) -> tuple[tuple[str, ...], str]:
    """Names of the columns of joints or bodies, and where they come from."""
    if array is None:
        return (), ""
    plural = {"joint": "joints", "body": "bodies"}[what]
    if own:
        if option is not None:
            raise InputError(f"--{what}-order: is given, but {source.source} names its {plural}")
        return own, "names in the file"
    chosen, count = option or usual, array.shape[1]
    names = named_order(f"--{what}-order", chosen, orders)
    if len(names) != count:
        known = f", and the order '{chosen}' has {len(names)} ({', '.join(names)})"
        if what == "body":
            known = f"; the contract has {len(orders['contract'])}, the robot {len(orders['mjcf'])}"
        raise InputError(
            f"{source.source}: has {count} {plural} per frame{known}; say which they are with --{what}-order"
        )
    return names, f"--{what}-order {chosen}" if option else f"assumed: {chosen}"


def named_order(option: str, value: str, known: Orders) -> tuple[str, ...]:
    """Return what an option such as --joint-order stands for: one of the known orders, or the names themselves."""
    if value in known:
        return known[value]
    names = tuple(name.strip() for name in value.split(","))
    if len(names) < 2 or not all(names):
        raise InputError(f"{option}: is '{value}', expected {', '.join(known)}, or names separated by commas")
    return names


def match_names(source: str, what: str, names: Iterable[str], wanted: Iterable[str], who: str) -> list[int]:
    """Places of the `wanted` names among `names`."""
    listed = list(names)
    for name in wanted:
        if name not in listed:
            raise InputError(f"{source}: {known_names(what, name, listed)} ({who} needs it)")
    return [listed.index(name) for name in wanted]


def interpret(source: SourceMotion, conventions: Conventions, skeleton: Skeleton) -> SourceMotion:
    """Return the motion with its columns named: joints in the robot's order, SI units, quaternions w x y z.

    The pose of the base is taken from the bodies where they hold it in the world. Raises `InputError` if the robot has
    a joint that the motion does not, or the other way round; likewise for bodies.
    """
    position, velocity = source.joint_position, source.joint_velocity
    if conventions.angle_unit == "deg":
        position, velocity = (None if array is None else np.radians(array) for array in (position, velocity))
    if position is not None:
        match_names(source.source, "joint of the motion", skeleton.joints, conventions.joint_names, "the motion")
        columns = match_names(source.source, "joint", conventions.joint_names, skeleton.joints, "the robot")
        position = position[:, columns]
        velocity = None if velocity is None else velocity[:, columns]
    bodies = conventions.body_names
    match_names(source.source, "body", skeleton.bodies, bodies, "the motion")
    body_quaternion = _wxyz(source.body_quaternion, conventions)
    base_position, base_quaternion = source.base_position, _wxyz(source.base_quaternion, conventions)
    has_base = source.frame == "world" and skeleton.base in bodies
    if has_base and source.body_position is not None and body_quaternion is not None:
        base = bodies.index(skeleton.base)
        base_position, base_quaternion = source.body_position[:, base], body_quaternion[:, base]
    return replace(
        source,
        joint_position=position,
        joint_velocity=velocity,
        joint_names=skeleton.joints,
        body_names=bodies,
        body_quaternion=body_quaternion,
        base_position=base_position,
        base_quaternion=base_quaternion,
        quaternion_order="wxyz",
    )


def _wxyz(quaternion: FloatArray | None, conventions: Conventions) -> FloatArray | None:
    """From the body to the world."""
    if quaternion is None:
        return None
    return np.ascontiguousarray(swap_quaternion_order(quaternion, conventions.quaternions))
