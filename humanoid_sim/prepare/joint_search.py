"""Find the order of a motion's joints from the orientations of its bodies.

Between two bodies that the motion holds, one above the other in the robot's tree, lie a few hinges. Only the right
columns turn the lower body as the motion has it, so each such stretch is searched by itself: for a stretch of k hinges
and n columns that is n^k products of rotations instead of n! orders of the whole robot.
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import Conventions, interpret
from humanoid_sim.prepare.skeleton import Hinge, Skeleton
from humanoid_sim.prepare.source import SourceMotion

__all__ = ["search_joint_order"]

_MOST_CHOICES = 60_000
"""n^k beyond which a stretch is not searched: it would take minutes and gigabytes."""


def search_joint_order(source: SourceMotion, conventions: Conventions, skeleton: Skeleton) -> tuple[str, ...] | None:
    """Names of the motion's joint columns as its body orientations have them; None if they cannot be found.

    The answer is a guess until forward kinematics has confirmed it: columns of joints that do not move, or that turn
    no body of the motion, go where there is place.

    Args:
        source: a motion of few frames.
        conventions: with the right bodies and the right order of quaternions.
        skeleton: of the robot.
    """
    try:
        motion = interpret(source, conventions, skeleton)
    except InputError:
        return None
    columns = source.joint_position
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
