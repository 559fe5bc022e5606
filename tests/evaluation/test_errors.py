import numpy as np
import pytest

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.evaluation.errors import pose_error, quaternion_angle


def turned(angle, axis):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_angle_between_quaternions_is_exact_from_tiny_to_half_a_turn(angle, sign):
    start = turned(0.7, (0.0, 0.6, 0.8))
    other = sign * multiply(start, turned(angle, (0.6, 0.0, 0.8)))
    assert quaternion_angle(start, other) == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_a_pose_error_is_offset_angle_and_tilt():
    pose = np.array([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    heading, leaning = turned(1.0, (0.0, 0.0, 1.0)), turned(0.5, (1.0, 0.0, 0.0))
    error = pose_error(np.stack([pose, pose]), np.array([[1.0, 2.3, 3.4], pose[:3]]), np.stack([heading, leaning]))
    assert error.offset[0] == pytest.approx([0.0, 0.3, 0.4])
    assert error.distance == pytest.approx([0.5, 0.0])
    assert error.angle == pytest.approx([1.0, 0.5])
    assert error.tilt == pytest.approx([0.0, 0.5])
