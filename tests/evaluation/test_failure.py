import numpy as np
import pytest

from humanoid_sim.controllers.rotation import multiply
from humanoid_sim.evaluation import failure
from humanoid_sim.simulation.floating_base import BaseState


def leaning(tilt):
    zero = np.zeros_like(tilt)
    return np.stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero], axis=-1)


def about(angle, axis):
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * np.array(axis))])


def test_a_fall_is_a_tilt_of_more_than_1_rad_or_less_than_six_tenths_of_the_height():
    height, tilt = np.array([0.8, 0.49, 0.47, 0.8, 0.8]), np.array([0.0, 0.0, 0.0, 0.99, 1.01])
    zeros = np.zeros((5, 3))
    position = np.column_stack([np.zeros(5), np.zeros(5), height])
    bases = BaseState(zeros, leaning(tilt), zeros, zeros, position, np.zeros(5))
    assert failure.has_fallen(bases, 0.8).tolist() == [False, False, True, False, True]
    assert failure.has_fallen(bases, np.array([0.8, 0.9, 0.7, 0.8, 0.8])).tolist() == [False, True, False, False, True]


def test_an_anchor_strays_by_height_or_tilt_and_not_by_heading_or_place():
    offset = np.array([[5.0, 5.0, 0.34], [0.0, 0.0, -0.36], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, np.nan]])
    turn = np.stack([*leaning(np.array([0.0, 0.0, 1.19, 1.21])), about(3.0, (0.0, 0.0, 1.0))])
    pose = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (5, 1))
    assert failure.has_strayed(pose, offset, turn).tolist() == [False, True, False, True, True]


def test_a_body_strays_by_its_distance():
    distance = np.array([[0.1, 0.29], [0.31, 0.0], [np.nan, 0.0]])
    assert failure.body_has_strayed(distance).tolist() == [False, True, True]


def test_joints_that_no_motor_could_turn_as_fast_are_a_fault():
    assert failure.has_run_away(np.array([[0.0, -99.0], [0.0, -101.0]])).tolist() == [False, True]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_angle_between_quaternions_is_exact_from_tiny_to_half_a_turn(angle, sign):
    start = about(0.7, (0.0, 0.6, 0.8))
    other = sign * multiply(start, about(angle, (0.6, 0.0, 0.8)))
    assert failure.quaternion_angle(start, other) == pytest.approx(angle, rel=1e-6, abs=1e-15)
