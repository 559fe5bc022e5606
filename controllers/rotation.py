"""Rotations as plain element-wise arithmetic, so that a batch gives bit for bit what its members give one by one.

Quaternions are (w, x, y, z), shape (..., 4); vectors are shape (..., 3); matrices are shape (..., 3, 3).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = [
    "conjugate",
    "gravity_direction",
    "matrix",
    "multiply",
    "rotate",
    "rotate_inverse",
    "yaw_quaternion",
]


def conjugate(quaternion: FloatArray) -> FloatArray:
    """The inverse rotation of a unit quaternion."""
    inverse: FloatArray = quaternion * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product: the rotation `b` followed by `a`."""
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def rotate(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q) v`: a vector given in the body frame, in the world frame."""
    w, xyz = quaternion[..., :1], quaternion[..., 1:]
    twice = 2.0 * _cross(xyz, vector)
    return vector + w * twice + _cross(xyz, twice)


def rotate_inverse(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q)ᵀ v`: a vector given in the world frame, in the body frame."""
    return rotate(conjugate(quaternion), vector)


def gravity_direction(quaternion: FloatArray) -> FloatArray:
    """The direction of gravity in the body frame, (0, 0, -1) when upright."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return np.stack([2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0], axis=-1)


def matrix(quaternion: FloatArray) -> FloatArray:
    """The rotation matrix, shape (..., 3, 3); its columns are the body's axes in the world frame."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def yaw_quaternion(quaternion: FloatArray) -> FloatArray:
    """The heading alone: the rotation about the vertical that is closest to `quaternion`."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    half = 0.5 * np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def _cross(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> FloatArray:
    # numpy.cross is three times slower on single vectors.
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
