import math

import numpy as np
import pytest

from humanoid_sim.controllers.rotation import (
    continuous,
    matrix,
    quaternion_from_matrix,
    rotation_6d,
    rotation_angle,
    rotation_from_6d,
    seen_from,
    slerp,
)


def random_quaternions(count):
    q = np.random.default_rng(3).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_matrices_and_back():
    half_turns = np.eye(4)[1:]
    quaternions = np.concatenate([random_quaternions(50), half_turns, [[1.0, 0.0, 0.0, 0.0]]])
    back = quaternion_from_matrix(matrix(quaternions))
    np.testing.assert_allclose(matrix(back), matrix(quaternions), atol=1e-12)
    assert (back[:, 0] >= 0.0).all()


def test_a_matrix_that_is_not_quite_a_rotation():
    rotations = matrix(random_quaternions(5))
    noisy = rotations + 1e-4 * np.random.default_rng(0).normal(size=rotations.shape)
    back = quaternion_from_matrix(noisy)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrix(back), rotations, atol=5e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_half_way_along_the_shorter_arc(sign):
    angle = 1.2
    start = np.array([1.0, 0.0, 0.0, 0.0])
    stop = sign * np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    half = slerp(start, stop, np.array([0.25]))
    np.testing.assert_allclose(half, [np.cos(angle / 8), 0.0, 0.0, np.sin(angle / 8)], atol=1e-12)


def test_between_equal_rotations():
    q = random_quaternions(4)
    np.testing.assert_allclose(slerp(q, q, np.full((4, 1), 0.3)), q, atol=1e-12)


def _rotation(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 3.0, math.pi])
def test_rotation_angle_is_exact_from_tiny_to_half_a_turn(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    assert rotation_angle(np.eye(3), _rotation(axis, angle)) == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_columns_that_are_not_orthonormal_are_made_so():
    rotation = _rotation(np.array([0.6, 0.0, 0.8]), 1.1)
    columns = rotation_6d(rotation).reshape(3, 2) * [1.3, 0.7]
    columns[:, 1] += 0.2 * columns[:, 0]
    np.testing.assert_allclose(rotation_from_6d(columns.reshape(6)), rotation, atol=1e-12)


def test_six_d_is_the_first_two_columns_row_by_row():
    rotation = np.arange(9.0).reshape(3, 3)
    assert rotation_6d(rotation).tolist() == [0, 1, 3, 4, 6, 7]
    assert rotation_6d(np.stack([rotation] * 4).reshape(2, 2, 3, 3)).shape == (2, 2, 6)


def test_poses_seen_from_a_base():
    base = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # looks along +y
    position, quaternion = seen_from(np.array([1.0, 0.0, 0.5]), base, np.array([[1.0, 2.0, 0.5]]), base[None])
    np.testing.assert_allclose(position, [[2.0, 0.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(quaternion, [[1.0, 0.0, 0.0, 0.0]], atol=1e-15)


def test_a_continuous_sequence_keeps_its_sign():
    angle = np.linspace(0.0, 4.0 * np.pi, 101)
    turning = np.stack([np.cos(angle / 2), np.zeros(101), np.zeros(101), np.sin(angle / 2)], axis=-1)
    sign = np.where(np.random.default_rng(0).random((101, 2, 1)) < 0.5, -1.0, 1.0)
    sign[0] = [[1.0], [-1.0]]
    made = continuous(sign * turning[:, None])
    np.testing.assert_array_equal(made[:, 0], turning)
    np.testing.assert_array_equal(made[:, 1], -turning)
    np.testing.assert_array_equal(continuous(turning[:1]), turning[:1])
