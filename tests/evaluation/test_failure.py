import numpy as np
import pytest

from humanoid_sim.evaluation import failure
from humanoid_sim.evaluation.errors import PoseError
from humanoid_sim.evaluation.failure import DEFINITIONS, differing
from humanoid_sim.simulation.floating_base import BaseState


def leaning(tilt):
    zero = np.zeros_like(tilt)
    return np.stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero], axis=-1)


def base(height, tilt):
    zeros = np.zeros((*height.shape, 3))
    position = zeros.copy()
    position[..., 2] = height
    return BaseState(zeros, leaning(tilt), zeros, zeros, position, np.zeros_like(height))


def test_a_fall_is_a_tilt_of_more_than_1_rad_or_less_than_six_tenths_of_the_height():
    bases = base(np.array([0.8, 0.49, 0.47, 0.8, 0.8]), np.array([0.0, 0.0, 0.0, 0.99, 1.01]))
    assert failure.has_fallen(bases, 0.8).tolist() == [False, False, True, False, True]
    assert failure.has_fallen(bases, np.array([0.8, 0.9, 0.7, 0.8, 0.8])).tolist() == [False, True, False, False, True]


def test_an_anchor_strays_by_height_or_tilt_and_not_by_heading_or_place():
    offset = np.array([[5.0, 5.0, 0.34], [0.0, 0.0, -0.36], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, np.nan]])
    turn = np.stack([*leaning(np.array([0.0, 0.0, 1.19, 1.21])), np.array([np.cos(1.5), 0.0, 0.0, np.sin(1.5)])])
    error = PoseError(offset, turn)
    assert failure.has_strayed(error).tolist() == [False, True, False, True, True]
    assert error.angle[4] == pytest.approx(3.0)
    assert error.tilt[4] == 0.0


def test_a_body_strays_by_its_distance():
    distance = np.array([[0.1, 0.29], [0.31, 0.0], [np.nan, 0.0]])
    assert failure.body_has_strayed(distance).tolist() == [False, True, True]


def test_joints_that_no_motor_could_turn_as_fast_are_a_fault():
    assert failure.has_run_away(np.array([[0.0, -99.0], [0.0, -101.0]])).tolist() == [False, True]


def test_what_differs_is_named():
    assert differing(DEFINITIONS) == ()
    assert differing({**DEFINITIONS, "loss": "it is out of sight"}) == ("loss",)
    assert differing({}) == ("fall", "loss", "errors")
    assert differing({**DEFINITIONS, "more": "than there is today"}) == ()
