"""If a motion does not fit a robot: would it, with its columns in another order, or its numbers in other units?

Every answer is checked by the same forward kinematics as the motion itself, on frames spread over it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, combinations, product

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    Conventions,
    NamedMotion,
    in_si,
    interpret,
)
from humanoid_sim.prepare.motion_fit import Tolerance, check_bodies
from humanoid_sim.prepare.skeleton import Hinge, Orders, Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, other_quaternion_order

__all__ = ["search_joint_order", "what_would_fit"]

_FRAMES = 12
_MUCH = 0.1
"""What must remain of the error of a motion that comes much nearer."""
_MOST_CHOICES = 60_000
"""Choices of columns beyond which a stretch of hinges is not searched: it would take minutes and gigabytes."""


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
    for candidate, words in chain(named, _unnamed_orders(few, conventions, skeleton, tolerance)):
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


def _unnamed_orders(
    few: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance
) -> Iterator[tuple[Conventions, str]]:
    """Two joints in each other's place; then any order of joints, or of bodies, that the poses themselves give."""
    for quaternions in (conventions.quaternions, other_quaternion_order(conventions.quaternions)):
        read = replace(conventions, quaternions=quaternions)
        extra = "" if quaternions == conventions.quaternions else f" and --quaternions {quaternions}"
        for a, b in combinations(range(len(read.joint_names)), 2):
            names = list(read.joint_names)
            names[a], names[b] = names[b], names[a]
            yield replace(read, joint_names=tuple(names)), f"the joints {names[b]} and {names[a]} exchanged{extra}"
        joints = search_joint_order(few, read, skeleton)
        if joints is not None:
            yield replace(read, joint_names=joints), f"--joint-order {','.join(joints)}{extra}"
        bodies = _search_body_order(interpret(few, read, skeleton), skeleton, tolerance)
        if bodies is not None:
            yield replace(read, body_names=bodies), f"--body-order {','.join(bodies)}{extra}"


def search_joint_order(source: SourceMotion, conventions: Conventions, skeleton: Skeleton) -> tuple[str, ...] | None:
    """Names of the motion's joint columns as its body orientations have them; None if they cannot be found.

    Between two bodies that the motion holds, one above the other in the robot's tree, lie a few hinges. Only the right
    columns turn the lower body as the motion has it, so each such stretch is searched by itself: for a stretch of k
    hinges and n columns that is n^k products of rotations instead of n! orders of the whole robot.

    The answer is a guess until forward kinematics has confirmed it: columns of joints that do not move, or that turn
    no body of the motion, go where there is place.

    The motion has few frames; bodies and order of quaternions are right.
    """
    try:
        motion = interpret(source, conventions, skeleton)
    except InputError:
        return None
    columns = in_si(source, conventions).joint_position
    if columns is None or motion.body_quaternion is None or set(conventions.joint_names) != set(skeleton.joints):
        return None
    rotations = dict(zip(motion.body_names, np.moveaxis(matrix(motion.body_quaternion), 1, 0), strict=True))
    if not motion.is_world:
        rotations.setdefault(skeleton.base, np.broadcast_to(np.eye(3), (len(columns), 3, 3)))
    elif motion.base_quaternion is not None:
        rotations.setdefault(skeleton.base, matrix(motion.base_quaternion))
    found: dict[str, int] = {}
    stretches = sorted((_stretch(skeleton, name, rotations) for name in rotations), key=lambda item: len(item[1]))
    for top, steps, bottom in stretches:
        hinges = [hinge for _, turned in steps for hinge in turned if hinge.name in skeleton.joints]
        if not top or not hinges or len(columns[0]) ** len(hinges) > _MOST_CHOICES:
            continue
        relative = np.swapaxes(rotations[top], -1, -2) @ rotations[bottom]
        for hinge, column in zip(hinges, _best(columns, steps, relative, skeleton, list(found.values())), strict=True):
            found[hinge.name] = column
    if not found:
        return None
    left = [column for column in range(columns.shape[1]) if column not in found.values()]
    for joint in conventions.joint_names:
        if joint not in found:
            found[joint] = left.pop(0)
    return tuple(sorted(found, key=lambda joint: found[joint]))


def _stretch(
    skeleton: Skeleton, bottom: str, known: dict[str, FloatArray]
) -> tuple[str, list[tuple[FloatArray, tuple[Hinge, ...]]], str]:
    """The nearest known body above `bottom` (empty for none), and the fixed turns and hinges on the way down."""
    steps: list[tuple[FloatArray, tuple[Hinge, ...]]] = []
    name = bottom
    while name in skeleton.links:
        link = skeleton.links[name]
        steps.insert(0, (link.rotation, link.hinges))
        name = link.parent
        if name in known:
            return name, steps, bottom
    return "", [], bottom


def _best(
    columns: FloatArray,
    steps: list[tuple[FloatArray, tuple[Hinge, ...]]],
    relative: FloatArray,
    skeleton: Skeleton,
    taken: list[int],
) -> list[int]:
    """The columns, one for each hinge of the stretch, that turn it most nearly by `relative` (T, 3, 3)."""
    frames, count = columns.shape
    product = np.broadcast_to(np.eye(3), (1, frames, 3, 3))
    choices = np.empty((1, 0), dtype=np.intp)
    free = np.array([column for column in range(count) if column not in taken], dtype=np.intp)
    for rotation, hinges in steps:
        product = product @ rotation
        for hinge in hinges:
            if hinge.name not in skeleton.joints:
                continue
            turns = np.moveaxis(_turn(hinge.axis, columns[:, free] - hinge.zero), 1, 0)
            product = (product[:, None] @ turns[None]).reshape(-1, frames, 3, 3)
            choices = np.concatenate(
                [np.repeat(choices, len(free), axis=0), np.tile(free, len(choices))[:, None]], axis=1
            )
            # A column drives one joint.
            different = np.array([len(set(row)) == len(row) for row in choices.tolist()])
            product, choices = product[different], choices[different]
    error = rotation_angle(product, relative).max(axis=-1)
    return [int(column) for column in choices[int(error.argmin())]]


def _turn(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) about an axis (3,) by angles (...), rad."""
    half = 0.5 * angle[..., None]
    return matrix(np.concatenate([np.cos(half), np.sin(half) * axis], axis=-1))


def _search_body_order(motion: NamedMotion, skeleton: Skeleton, tolerance: Tolerance) -> tuple[str, ...] | None:
    """Names of the motion's bodies such that each is where forward kinematics puts it; None if there are none.

    The motion has few frames, the right joints and the right order of quaternions.
    """
    if motion.joint_position is None or motion.body_position is None or motion.body_quaternion is None:
        return None
    place, turn = skeleton.poses(motion.joint_position, skeleton.bodies)
    rotation = matrix(motion.body_quaternion)
    if not motion.is_world:
        return _assign(motion.body_position, rotation, place, turn, skeleton, tolerance)
    # A floating base is among the bodies; a fixed one need not be, so any body may be the one that is known.
    known = (skeleton.base,) if skeleton.description.is_floating else skeleton.bodies
    for name, column in product(known, range(motion.body_position.shape[1])):
        body = skeleton.bodies.index(name)
        # The pose of the base, if this column is this body.
        back = turn[:, body] @ np.swapaxes(rotation[:, column], -1, -2)
        offset = motion.body_position - motion.body_position[:, column, None]
        position = np.einsum("tij,tbj->tbi", back, offset) + place[:, body, None]
        names = _assign(position, back[:, None] @ rotation, place, turn, skeleton, tolerance)
        if names is not None and names[column] == name:
            return names
    return None


def _assign(
    position: FloatArray,
    rotation: FloatArray,
    place: FloatArray,
    turn: FloatArray,
    skeleton: Skeleton,
    tolerance: Tolerance,
) -> tuple[str, ...] | None:
    """To each body of the motion the nearest of the robot's, if all are near and no two the same."""
    offset = position[:, :, None] - place[:, None]
    distance = np.sqrt((offset * offset).sum(axis=-1)).max(axis=0)
    angle = rotation_angle(rotation[:, :, None], turn[:, None]).max(axis=0)
    error = np.maximum(distance / tolerance.position, angle / tolerance.angle)
    nearest = error.argmin(axis=1)
    if error.min(axis=1).max() > 1.0 or len(set(nearest.tolist())) < len(nearest):
        return None
    return tuple(skeleton.bodies[int(body)] for body in nearest)
