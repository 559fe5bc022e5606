"""Feet: found in the model, and seen to slide."""

import numpy as np
import pytest

from humanoid_sim.evaluation.feet import Feet, find_feet
from humanoid_sim.robots.description import load_robot


def test_the_feet_of_the_legged_lite():
    feet = find_feet(load_robot("lite_biped"))
    assert feet.bodies == ("left_foot", "right_foot")
    assert feet.points.shape == (len(feet.foot), 3)
    assert set(feet.foot) == {0, 1}


def ball(speed, height):
    """A round foot of 3 cm at two instants 0.02 s apart."""
    before = np.array([[[0.0, 0.0, height]]])
    return before, before + np.array([0.6, 0.8, 0.0]) * speed * 0.02


FEET = Feet(bodies=("foot",), foot=(0,), points=np.zeros((1, 3)), radius=np.array([0.03]), floor=0.0)


def test_a_foot_on_the_ground_slips_at_its_speed():
    assert FEET.slip(*ball(0.5, 0.03), 0.02) == pytest.approx([0.5])
    assert FEET.slip(*ball(0.0, 0.03), 0.02) == [0.0]


def test_a_foot_in_the_air_does_not():
    assert np.isnan(FEET.slip(*ball(0.5, 0.05), 0.02)).all()


def test_a_foot_that_has_just_landed_does_not_count():
    before, after = ball(0.5, 0.03)
    before[..., 2] = 0.1
    assert np.isnan(FEET.slip(before, after, 0.02)).all()
