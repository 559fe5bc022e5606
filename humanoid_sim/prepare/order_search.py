"""If a motion does not fit a robot: would it, with its columns in another order, or its numbers in other units?

Every answer is checked by the same forward kinematics as the motion itself, on frames spread over it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, combinations, product

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.conventions import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    Conventions,
    interpret,
)
from humanoid_sim.prepare.motion_fit import Tolerance, check_bodies
from humanoid_sim.prepare.skeleton import Orders, Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, other_quaternion_order

_FRAMES = 12
_MUCH = 0.1
"""What must remain of the error of a motion that comes much nearer."""


def what_would_fit(
    source: SourceMotion,
    conventions: Conventions,
    skeleton: Skeleton,
    tolerance: Tolerance,
    joint_orders: Orders,
    body_orders: Orders,
) -> str:
    """The options with which a motion that was read by these conventions would fit; empty if none tried does.

    Where none does, but one brings the bodies much nearer, it is that one, with what remains.
    """
    frames = np.linspace(0, source.frame_count - 1, min(_FRAMES, source.frame_count)).round()
    few = source.select(np.unique(frames.astype(np.intp)))
    present, best, best_words = np.inf, np.inf, ""
    named = _named_orders(conventions, joint_orders, body_orders)
    for candidate, words in chain(named, _exchanged_joints(conventions)):
        try:
            checks = check_bodies(interpret(few, candidate, skeleton), skeleton, tolerance)
        except InputError:  # a body order without the base of a floating robot
            continue
        excess = max((check.excess(tolerance) for check in checks), default=np.inf)
        if not words:
            present = excess
        elif excess <= 1.0:
            return f"it would fit with {words}"
        elif excess < best:
            best, best_words = excess, words
    if best < _MUCH * present:
        return f"it would come {present / best:.0f} times nearer with {best_words}, but not within the tolerance"
    return ""


def _named_orders(
    conventions: Conventions, joint_orders: Orders, body_orders: Orders
) -> Iterator[tuple[Conventions, str]]:
    """Orders that exporters use, the other order of quaternions, the inverse rotations, other units.

    None changed comes first, without words; then one change before two, two before three.
    """
    joints = {"": conventions.joint_names} | _others(joint_orders, conventions.joint_names)
    bodies = {"": conventions.body_names} | _others(body_orders, conventions.body_names)
    present = conventions.quaternions
    turns = {"": present, other_quaternion_order(present): other_quaternion_order(present)}
    conjugates = {"": conventions.conjugate} | ({} if conventions.conjugate else {" ": True})
    angles = {"": conventions.angle_unit} | {unit: unit for unit in ANGLE_UNITS if unit != conventions.angle_unit}
    lengths = {"": conventions.length_unit} | {unit: unit for unit in LENGTH_UNITS if unit != conventions.length_unit}
    changes = sorted(
        product(joints, bodies, turns, conjugates, angles, lengths),
        key=lambda change: len(change) - change.count(""),
    )
    options = ("--joint-order", "--body-order", "--quaternions", "--conjugate", "--angle-unit", "--length-unit")
    for change in changes:
        joint, body, turn, conjugate, angle, length = change
        candidate = replace(
            conventions,
            joint_names=joints[joint],
            body_names=bodies[body],
            quaternions=turns[turn],
            conjugate=conjugates[conjugate],
            angle_unit=angles[angle],
            length_unit=lengths[length],
        )
        yield (
            candidate,
            " ".join(f"{option} {value}".rstrip() for option, value in zip(options, change, strict=True) if value),
        )


def _others(orders: Orders, present: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Known orders as long as the present one, and different from it and from each other."""
    found: dict[str, tuple[str, ...]] = {}
    for name, order in orders.items():
        if len(order) == len(present) and order != present and order not in found.values():
            found[name] = order
    return found


def _exchanged_joints(conventions: Conventions) -> Iterator[tuple[Conventions, str]]:
    """Two joints in each other's place, with either order of quaternions."""
    for quaternions in (conventions.quaternions, other_quaternion_order(conventions.quaternions)):
        extra = "" if quaternions == conventions.quaternions else f" and --quaternions {quaternions}"
        for a, b in combinations(range(len(conventions.joint_names)), 2):
            names = list(conventions.joint_names)
            names[a], names[b] = names[b], names[a]
            words = f"the joints {names[b]} and {names[a]} exchanged{extra}"
            yield replace(conventions, joint_names=tuple(names), quaternions=quaternions), words
