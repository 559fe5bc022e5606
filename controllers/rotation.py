"""Rotations as plain element-wise arithmetic, so that a batch gives bit for bit what its members give one by one.

Quaternions are (w, x, y, z), shape (..., 4); vectors are shape (..., 3); matrices are shape (..., 3, 3).
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.mit import FloatArray


def _parts(array: FloatArray) -> tuple[FloatArray, ...]:
    return tuple(array[..., i] for i in range(array.shape[-1]))


def _rows(rows: list[list[FloatArray]]) -> FloatArray:
    """Stack elements of shape (...) to matrices (..., r, c)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / np.sqrt((vector * vector).sum(axis=-1, keepdims=True)))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    (ax, ay, az), (bx, by, bz) = _parts(a), _parts(b)  # numpy.cross is three times slower on single vectors
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def conjugate(quaternion: FloatArray) -> FloatArray:
    """Return the inverse rotation of a unit quaternion."""
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]))


def continuous(quaternion: FloatArray) -> FloatArray:
    """Return the same rotations, (F, ..., 4), each on its predecessor's side: q and -q are one rotation."""
    flipped = (quaternion[1:] * quaternion[:-1]).sum(axis=-1, keepdims=True) < 0.0
    sign = np.cumprod(np.where(flipped, -1.0, 1.0), axis=0)
    return np.concatenate([quaternion[:1], sign * quaternion[1:]])


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product: the rotation `b` followed by `a`."""
    (aw, ax, ay, az), (bw, bx, by, bz) = _parts(a), _parts(b)
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    return np.stack([w, x, y, z], axis=-1)


def rotate(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q) v`: a vector given in the body frame, in the world frame."""
    w, xyz = quaternion[..., :1], quaternion[..., 1:]
    twice = 2.0 * _cross(xyz, vector)
    return vector + w * twice + _cross(xyz, twice)


def rotate_inverse(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """`R(q)ᵀ v`: a vector given in the world frame, in the body frame."""
    return rotate(conjugate(quaternion), vector)


def seen_from(
    base_position: FloatArray, base_quaternion: FloatArray, position: FloatArray, quaternion: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return poses of bodies in the frame of a base: positions (..., b, 3) and quaternions (..., b, 4), world frame."""
    base = base_quaternion[..., None, :]
    return rotate_inverse(base, position - base_position[..., None, :]), multiply(conjugate(base), quaternion)


def gravity_direction(quaternion: FloatArray) -> FloatArray:
    """Return the direction of gravity in the body frame, (0, 0, -1) when upright."""
    w, x, y, z = _parts(quaternion)
    return np.stack([2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0], axis=-1)


def matrix(quaternion: FloatArray) -> FloatArray:
    """Return the rotation matrix, shape (..., 3, 3); its columns are the body's axes in the world frame."""
    w, x, y, z = _parts(quaternion)
    return _rows(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def heading(quaternion: FloatArray) -> FloatArray:
    """Shape (...), rad, of the body's x axis in the horizontal plane, -π to π."""
    w, x, y, z = _parts(quaternion)
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def yaw_quaternion(quaternion: FloatArray) -> FloatArray:
    """Return the heading alone: the rotation about the vertical that is closest to `quaternion`."""
    half = 0.5 * heading(quaternion)
    return np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1)


def quaternion_from_matrix(rotation: FloatArray) -> FloatArray:
    """Return unit quaternions (..., 4), w ≥ 0, of rotation matrices (..., 3, 3)."""
    # 4 q qᵀ is linear in the matrix; its row with the largest diagonal element, normalised, is ±q without cancellation
    # (Shepperd 1978, "Quaternion from rotation matrix").
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = (_parts(rotation[..., i, :]) for i in range(3))
    product = _rows(
        [
            [1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, 1.0 + xx - yy - zz, yx + xy, xz + zx],
            [xz - zx, yx + xy, 1.0 - xx + yy - zz, zy + yz],
            [yx - xy, xz + zx, zy + yz, 1.0 - xx - yy + zz],
        ]
    )
    best = np.argmax(np.diagonal(product, axis1=-2, axis2=-1), axis=-1)
    quaternion = _unit(np.take_along_axis(product, best[..., None, None], axis=-2)[..., 0, :])
    return np.where(quaternion[..., :1] < 0.0, -quaternion, quaternion)


def slerp(a: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """From `a` to `b`, unit quaternions (..., 4), along the shorter arc; `weight` in [0, 1] of shape (..., 1)."""
    cosine = (a * b).sum(axis=-1, keepdims=True)
    near = np.where(cosine < 0.0, -b, b)
    angle = np.arccos(np.minimum(np.abs(cosine), 1.0))
    sine = np.sin(angle)
    small = sine < 1e-6  # below a microradian the chord is the arc
    divisor = np.where(small, 1.0, sine)
    first = np.where(small, 1.0 - weight, np.sin((1.0 - weight) * angle) / divisor)
    second = np.where(small, weight, np.sin(weight * angle) / divisor)
    return _unit(first * a + second * near)


def rotation_angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angle between rotation matrices of shape (..., 3, 3): shape (...), rad, in [0, π]."""
    # |A - B| = 2√2 sin(angle / 2) in the Frobenius norm: unlike the arc cosine of the trace it is accurate near zero.
    norm = np.sqrt(((a - b) ** 2).sum(axis=(-2, -1)))
    return np.asarray(2.0 * np.arcsin(np.minimum(norm / (2.0 * np.sqrt(2.0)), 1.0)))


def rotation_6d(rotation: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3) → (..., 6): the first two columns, row by row: R00, R01, R10, R11, R20, R21."""
    return rotation[..., :2].reshape(*rotation.shape[:-2], 6)


def rotation_from_6d(columns: FloatArray) -> FloatArray:
    """Return rotation matrices (..., 3, 3) from their first two columns, row by row (..., 6), made orthonormal."""
    pair = columns.reshape(*columns.shape[:-1], 3, 2)
    x, y = _unit(pair[..., 0]), pair[..., 1]
    y = _unit(y - (x * y).sum(axis=-1, keepdims=True) * x)
    return np.stack([x, y, _cross(x, y)], axis=-1)
