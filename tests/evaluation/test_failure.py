from __future__ import annotations

import numpy as np
import pytest

from humanoid_sim.evaluation.errors import PoseError
from humanoid_sim.evaluation.failure import (
    body_has_strayed,
    describe_body_stray,
    describe_fall,
    describe_stray,
    has_fallen,
    has_strayed,
)
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.floating_base import BaseState


def leaning(tilt: FloatArray) -> FloatArray:
    zero = np.zeros_like(tilt)
    return np.stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero], axis=-1)


def base(height: FloatArray, tilt: FloatArray) -> BaseState:
    zeros = np.zeros((*height.shape, 3))
    position = zeros.copy()
    position[..., 2] = height
    return BaseState(position, leaning(tilt), zeros, zeros)


def test_a_fall_is_a_tilt_of_more_than_1_rad_or_less_than_six_tenths_of_the_height() -> None:
    bases = base(np.array([0.8, 0.49, 0.47, 0.8, 0.8]), np.array([0.0, 0.0, 0.0, 0.99, 1.01]))
    assert has_fallen(bases, 0.8).tolist() == [False, False, True, False, True]
    assert has_fallen(bases, np.array([0.8, 0.9, 0.7, 0.8, 0.8])).tolist() == [False, True, False, False, True]


@pytest.mark.parametrize(
    ("height", "tilt", "text"),
    [(0.3, 0.1, "fell: sank to 0.30 m"), (0.8, 1.2, "fell: tilted by 69°"), (0.3, 0.9, "fell: tilted by 52°")],
)
def test_a_fall_is_described_in_one_way_for_one_robot_and_for_one_of_many(
    height: float, tilt: float, text: str
) -> None:
    assert describe_fall(base(np.array(height), np.array(tilt))) == text
    assert describe_fall(base(np.array([0.8, height]), np.array([0.0, tilt])), 1) == text


def test_an_anchor_strays_by_height_or_tilt_and_not_by_heading_or_place() -> None:
    offset = np.array([[5.0, 5.0, 0.34], [0.0, 0.0, -0.36], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, np.nan]])
    turn = np.stack([*leaning(np.array([0.0, 0.0, 1.19, 1.21])), np.array([np.cos(1.5), 0.0, 0.0, np.sin(1.5)])])
    error = PoseError(offset, turn)
    assert has_strayed(error).tolist() == [False, True, False, True, True]
    assert describe_stray(error, 1) == "strayed: 0.36 m off the motion's height"
    assert describe_stray(error, 3) == "strayed: tilted by 69° against the motion"
    assert error.angle[4] == pytest.approx(3.0)
    assert error.tilt[4] == 0.0


def test_a_body_strays_by_its_distance() -> None:
    distance = np.array([[0.1, 0.29], [0.31, 0.0], [np.nan, 0.0]])
    assert body_has_strayed(distance**2).tolist() == [False, True, True]
    assert describe_body_stray(distance[1], ("left", "right")) == "strayed: left is 0.31 m from the motion"
    assert describe_body_stray(distance[2], ("left", "right")) == "strayed: left is nan m from the motion"
