"""Rotations against literal ones, at the ends where formulas break, and one by one as in a batch."""

import numpy as np
import pytest

from humanoid_sim.controllers import rotation
from humanoid_sim.controllers.rotation import matrix, quaternion_from_matrix, rotation_6d, rotation_from_6d, slerp


def random_quaternions(count):
    q = np.random.default_rng(3).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def about_z(angle):
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def test_matrices_and_back():
    half_turns = np.eye(4)[1:]
    quaternions = np.concatenate([random_quaternions(50), half_turns, [[1.0, 0.0, 0.0, 0.0]]])
    back = quaternion_from_matrix(matrix(quaternions))
    np.testing.assert_allclose(matrix(back), matrix(quaternions), atol=1e-12)
    assert (back[:, 0] >= 0.0).all()
    np.testing.assert_allclose(matrix(about_z(np.pi / 2)), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_vectors_and_gravity():
    x, quarter = np.array([1.0, 0.0, 0.0]), about_z(np.pi / 2)
    np.testing.assert_allclose(rotation.rotate(quarter, x), [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(rotation.rotate_inverse(quarter, x), [0.0, -1.0, 0.0], atol=1e-15)
    lying = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # pitched by a quarter: x points down
    np.testing.assert_allclose(rotation.gravity_direction(lying), [1.0, 0.0, 0.0], atol=1e-15)
    for q in random_quaternions(5):
        down = rotation.rotate_inverse(q, np.array([0.0, 0.0, -1.0]))
        np.testing.assert_allclose(rotation.gravity_direction(q), down, atol=1e-12)
        turned = rotation.multiply(about_z(0.3), q)
        assert np.isclose(np.angle(np.exp(1j * (rotation.heading(turned) - rotation.heading(q)))), 0.3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_between_two_rotations_along_the_shorter_arc(sign):
    quarter = slerp(about_z(0.0), sign * about_z(1.2), np.array([0.25]))
    np.testing.assert_allclose(quarter, about_z(0.3), atol=1e-12)
    q = random_quaternions(4)
    np.testing.assert_allclose(slerp(q, q, np.full((4, 1), 0.3)), q, atol=1e-12)


def test_six_d_is_the_first_two_columns_row_by_row_and_made_orthonormal():
    assert rotation_6d(np.arange(9.0).reshape(3, 3)).tolist() == [0, 1, 3, 4, 6, 7]
    turned = matrix(random_quaternions(1)[0])
    columns = rotation_6d(turned).reshape(3, 2) * [1.3, 0.7]
    columns[:, 1] += 0.2 * columns[:, 0]
    np.testing.assert_allclose(rotation_from_6d(columns.reshape(6)), turned, atol=1e-12)
