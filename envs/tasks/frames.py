"""Poses in the world seen from a base."""

from __future__ import annotations

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate_inverse
from humanoid_sim.mit import FloatArray

__all__ = ["seen_from"]


def seen_from(
    base_position: FloatArray, base_quaternion: FloatArray, position: FloatArray, quaternion: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Poses of bodies in the frame of a base.

    Args:
        base_position: shape (..., 3), m, world frame.
        base_quaternion: shape (..., 4), w x y z, base frame in the world frame.
        position: shape (..., b, 3), m, world frame.
        quaternion: shape (..., b, 4), body frames in the world frame.

    Returns:
        Shape (..., b, 3), m, and (..., b, 4), both in the base frame.
    """
    turn = base_quaternion[..., None, :]
    return rotate_inverse(turn, position - base_position[..., None, :]), multiply(conjugate(turn), quaternion)
