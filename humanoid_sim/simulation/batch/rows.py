"""Vectors and quaternions of a batch, stored component by component: rows of shape (N,), contiguous in memory.

Vectors are (3, …, N) and quaternions (4, …, N), w x y z; a constant is (3, …, 1) or (4, …, 1). The functions of
`humanoid_sim.controllers.rotation` do the same on (..., 3) and (..., 4), which suits one robot but strides through
memory on a thousand.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["column", "cross", "multiply", "normalize", "read_only", "rotate", "rotate_inverse"]

Scalar = TypeVar("Scalar", bound=np.generic)


def column(constant: FloatArray) -> FloatArray:
    """A constant of shape (k,) as (k, 1), to be broadcast over the batch."""
    return np.array(constant, dtype=np.float64).reshape(-1, 1)


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product: the rotation `b` followed by `a`."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    scalar = aw * bw - ax * bx - ay * by - az * bz
    product = np.empty((4, *scalar.shape))
    product[0] = scalar
    product[1] = aw * bx + ax * bw + ay * bz - az * by
    product[2] = aw * by - ax * bz + ay * bw + az * bx
    product[3] = aw * bz + ax * by - ay * bx + az * bw
    return product


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product."""
    first = a[1] * b[2] - a[2] * b[1]
    product = np.empty((3, *first.shape))
    product[0] = first
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
    return product


def rotate(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q) v`: a vector given in the body frame, in the world frame."""
    xyz = quaternion[1:]
    twice = 2.0 * cross(xyz, vector)
    turned: FloatArray = vector + quaternion[0] * twice + cross(xyz, twice)
    return turned


def rotate_inverse(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q)ᵀ v`: a vector given in the world frame, in the body frame."""
    xyz = -quaternion[1:]
    twice = 2.0 * cross(xyz, vector)
    turned: FloatArray = vector + quaternion[0] * twice + cross(xyz, twice)
    return turned


def normalize(quaternion: FloatArray) -> FloatArray:
    """The unit quaternion of the same direction."""
    w, x, y, z = quaternion
    unit: FloatArray = quaternion / np.sqrt(w * w + x * x + y * y + z * z)
    return unit


def read_only(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    """A view that cannot be written."""
    view = array.view()
    view.setflags(write=False)
    return view
