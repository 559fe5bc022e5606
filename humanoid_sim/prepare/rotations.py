"""Rotations that only conversions need: quaternions from matrices, and along the shortest arc between two of them."""

from __future__ import annotations

import numpy as np

from humanoid_sim.mit import FloatArray

__all__ = ["quaternion_from_matrix", "slerp"]


def quaternion_from_matrix(matrix: FloatArray) -> FloatArray:
    """Quaternions (..., 4), w x y z, w ≥ 0, of rotation matrices (..., 3, 3).

    Bar-Itzhack 2000: the eigenvector of the largest eigenvalue of a symmetric 4 × 4 matrix. It needs no case for every
    quadrant, and of a matrix that is not quite orthonormal it gives the closest rotation.
    """
    m = np.asarray(matrix, dtype=np.float64)
    k = np.empty((*m.shape[:-2], 4, 4))
    skew = ((2, 1), (0, 2), (1, 0))
    k[..., 0, 0] = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    for i, (row, column) in enumerate(skew):
        k[..., 0, i + 1] = k[..., i + 1, 0] = m[..., row, column] - m[..., column, row]
    for i in range(3):
        for j in range(3):
            k[..., i + 1, j + 1] = m[..., i, j] + m[..., j, i]
        k[..., i + 1, i + 1] -= k[..., 0, 0]
    _, vectors = np.linalg.eigh(k)
    quaternion = vectors[..., -1]
    positive: FloatArray = np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)
    return positive


def slerp(a: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """From `a` to `b`, unit quaternions (..., 4), along the shorter arc; `weight` in [0, 1] of shape (..., 1)."""
    cosine = (a * b).sum(axis=-1, keepdims=True)
    near = np.where(cosine < 0.0, -b, b)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(angle)
    # Below a microradian the chord is the arc.
    small = sine < 1e-6
    divisor = np.where(small, 1.0, sine)
    first = np.where(small, 1.0 - weight, np.sin((1.0 - weight) * angle) / divisor)
    second = np.where(small, weight, np.sin(weight * angle) / divisor)
    mixed = first * a + second * near
    unit: FloatArray = mixed / np.sqrt((mixed * mixed).sum(axis=-1, keepdims=True))
    return unit
