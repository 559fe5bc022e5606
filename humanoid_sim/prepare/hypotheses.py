"""If a motion does not fit a robot: would it, with its columns in another order?

Every answer is checked by the same forward kinematics as the motion itself, on frames spread over it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain, combinations, product

import numpy as np

from humanoid_sim.controllers.terms import QuaternionOrder
from humanoid_sim.errors import InputError
from humanoid_sim.prepare.body_search import search_body_order
from humanoid_sim.prepare.conventions import Conventions, interpret
from humanoid_sim.prepare.joint_search import search_joint_order
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source import SourceMotion
from humanoid_sim.prepare.verify import Tolerance, Verifier

__all__ = ["what_would_fit"]

_FRAMES = 12

Orders = Mapping[str, tuple[str, ...]]


def what_would_fit(
    source: SourceMotion,
    conventions: Conventions,
    skeleton: Skeleton,
    verifier: Verifier,
    tolerance: Tolerance,
    joint_orders: Orders,
    body_orders: Orders,
) -> str:
    """The options with which the motion would fit, in words; empty if none of those that were tried do.

    Args:
        source: the motion that does not fit.
        conventions: as it was read.
        skeleton: of the robot.
        verifier: for the robot.
        tolerance: of the comparison.
        joint_orders: known orders of the robot's joints by name.
        body_orders: likewise of its bodies.
    """
    few = _some_frames(source)
    named = _named_orders(conventions, joint_orders, body_orders)
    for candidate, words in chain(named, _unnamed_orders(few, conventions, skeleton, verifier, tolerance)):
        try:
            checks = verifier.check(interpret(few, candidate, skeleton), tolerance)
        except InputError:  # a body order without the base of a floating robot
            continue
        if checks and max(check.excess(tolerance) for check in checks) <= 1.0:
            return f"it would fit with {words}"
    return ""


def _some_frames(source: SourceMotion) -> SourceMotion:
    frames = np.unique(np.linspace(0, source.frame_count - 1, min(_FRAMES, source.frame_count)).round().astype(np.intp))
    return source.select(frames)


def _named_orders(
    conventions: Conventions, joint_orders: Orders, body_orders: Orders
) -> Iterator[tuple[Conventions, str]]:
    """Orders that exporters use, and the other order of quaternions; one change before two, two before three."""
    joints = {"": conventions.joint_names} | _others(joint_orders, conventions.joint_names)
    bodies = {"": conventions.body_names} | _others(body_orders, conventions.body_names)
    changes = product(joints, bodies, (conventions.quaternions, _swapped(conventions)))
    for joint, body, quaternions in sorted(changes, key=lambda change: _count(change, conventions)):
        swap = "" if quaternions == conventions.quaternions else quaternions
        if joint or body or swap:
            candidate = replace(
                conventions, joint_names=joints[joint], body_names=bodies[body], quaternions=quaternions
            )
            values = (("--joint-order", joint), ("--body-order", body), ("--quaternions", swap))
            yield candidate, " ".join(f"{option} {value}" for option, value in values if value)


def _count(change: tuple[str, str, QuaternionOrder], conventions: Conventions) -> int:
    joint, body, quaternions = change
    return bool(joint) + bool(body) + (quaternions != conventions.quaternions)


def _swapped(conventions: Conventions) -> QuaternionOrder:
    return "xyzw" if conventions.quaternions == "wxyz" else "wxyz"


def _others(orders: Orders, present: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Known orders as long as the present one, and different from it and from each other."""
    found: dict[str, tuple[str, ...]] = {}
    for name, order in orders.items():
        if len(order) == len(present) and order != present and order not in found.values():
            found[name] = order
    return found


def _unnamed_orders(
    few: SourceMotion, conventions: Conventions, skeleton: Skeleton, verifier: Verifier, tolerance: Tolerance
) -> Iterator[tuple[Conventions, str]]:
    """Two joints in each other's place; then any order of joints, or of bodies, that the poses themselves give."""
    for quaternions in (conventions.quaternions, _swapped(conventions)):
        read = replace(conventions, quaternions=quaternions)
        extra = "" if quaternions == conventions.quaternions else f" and --quaternions {quaternions}"
        for a, b in combinations(range(len(read.joint_names)), 2):
            names = list(read.joint_names)
            names[a], names[b] = names[b], names[a]
            yield replace(read, joint_names=tuple(names)), f"the joints {names[b]} and {names[a]} exchanged{extra}"
        joints = search_joint_order(few, read, skeleton)
        if joints is not None:
            yield replace(read, joint_names=joints), f"--joint-order {','.join(joints)}{extra}"
        bodies = search_body_order(interpret(few, read, skeleton), skeleton, verifier, tolerance)
        if bodies is not None:
            yield replace(read, body_names=bodies), f"--body-order {','.join(bodies)}{extra}"
