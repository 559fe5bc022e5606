import numpy as np
import pytest

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.prepare.rotations import quaternion_from_matrix, slerp


def random_quaternions(count: int) -> np.ndarray:
    q = np.random.default_rng(3).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def test_matrices_and_back() -> None:
    half_turns = np.eye(4)[1:]
    quaternions = np.concatenate([random_quaternions(50), half_turns, [[1.0, 0.0, 0.0, 0.0]]])
    back = quaternion_from_matrix(matrix(quaternions))
    np.testing.assert_allclose(matrix(back), matrix(quaternions), atol=1e-12)
    assert (back[:, 0] >= 0.0).all()


def test_a_matrix_that_is_not_quite_a_rotation() -> None:
    rotations = matrix(random_quaternions(5))
    noisy = rotations + 1e-4 * np.random.default_rng(0).normal(size=rotations.shape)
    back = quaternion_from_matrix(noisy)
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrix(back), rotations, atol=5e-4)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_half_way_along_the_shorter_arc(sign: float) -> None:
    angle = 1.2
    start = np.array([1.0, 0.0, 0.0, 0.0])
    stop = sign * np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    half = slerp(start, stop, np.array([0.25]))
    np.testing.assert_allclose(half, [np.cos(angle / 8), 0.0, 0.0, np.sin(angle / 8)], atol=1e-12)


def test_between_equal_rotations() -> None:
    q = random_quaternions(4)
    np.testing.assert_allclose(slerp(q, q, np.full((4, 1), 0.3)), q, atol=1e-12)
