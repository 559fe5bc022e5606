"""Find which bodies of the robot a motion's bodies are, from where they are."""

from __future__ import annotations

from itertools import product

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import NamedMotion
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.verify import Tolerance, Verifier

__all__ = ["search_body_order"]


def search_body_order(
    motion: NamedMotion, skeleton: Skeleton, verifier: Verifier, tolerance: Tolerance
) -> tuple[str, ...] | None:
    """Names of the motion's bodies such that each is where forward kinematics puts it; None if there are none.

    Args:
        motion: a motion of few frames, with the right joints and the right order of quaternions.
        skeleton: of the robot.
        verifier: for the robot.
        tolerance: within which a body is found.
    """
    if motion.joint_position is None or motion.body_position is None or motion.body_quaternion is None:
        return None
    place, turn = verifier.poses(motion.joint_position, skeleton.bodies)
    rotation = matrix(motion.body_quaternion)
    if not motion.is_world:
        return _assign(motion.body_position, rotation, place, turn, skeleton, tolerance)
    # A floating base is among the bodies; a fixed one need not be, so any body may be the one that is known.
    known = (skeleton.base,) if verifier.is_floating else skeleton.bodies
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
