from __future__ import annotations

import math

import numpy as np
import pytest

from humanoid_sim.hardware.robot.joint_tracking import JointTracker
from humanoid_sim.hardware.robot.wiring import Wiring, make_wiring
from humanoid_sim.hardware.robstride.motor_table import Readings, nothing_heard
from humanoid_sim.robots.schema import RobotDescription


@pytest.fixture
def wiring(description: RobotDescription) -> Wiring:
    return make_wiring(description, 2, {"left": 0.5, "right": -1.0})


def _readings(time: float, position: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Readings:
    pair = np.array
    return Readings(np.full(2, time), pair(position), pair(velocity), pair([1.0, 2.0]), np.full(2, 25.0))


def test_direction_offset_and_turns_make_the_joint_frame(wiring: Wiring) -> None:
    tracker = JointTracker(wiring, np.array([0.0, -1.0]))
    joints = tracker.update(_readings(1.0, (0.75, 2.0 * math.pi), (3.0, 4.0)))
    assert joints.position.tolist() == pytest.approx([-0.25, 1.0])
    assert joints.velocity.tolist() == [-3.0, 4.0]
    assert joints.effort.tolist() == [-1.0, 2.0]
    assert joints.time.tolist() == [1.0, 1.0]


def test_commands_go_back_the_way_that_positions_came(wiring: Wiring) -> None:
    tracker = JointTracker(wiring, np.array([1.0, -1.0]))
    reported = np.array([0.75, 5.0])
    joints = tracker.update(_readings(1.0, (0.75, 5.0)))
    np.testing.assert_allclose(tracker.to_motor(joints.position), reported, atol=1e-12)


def test_what_was_never_heard_is_unknown(wiring: Wiring) -> None:
    joints = JointTracker(wiring, np.zeros(2)).update(nothing_heard(2))
    assert np.isnan(joints.position).all()
    assert joints.velocity.tolist() == joints.effort.tolist() == [0.0, 0.0]
    assert joints.time.tolist() == [-math.inf, -math.inf]


def test_on_an_unknown_turn_a_position_is_unknown(wiring: Wiring) -> None:
    joints = JointTracker(wiring, np.array([np.nan, 0.0])).update(_readings(1.0, (0.75, 0.0)))
    assert math.isnan(joints.position[0])
    assert joints.velocity[0] == 0.0
    assert math.isfinite(joints.position[1])


def test_a_motor_that_turns_beyond_its_report_is_followed_and_noticed(wiring: Wiring) -> None:
    tracker = JointTracker(wiring, np.zeros(2))
    edge = 4.0 * math.pi
    for time, position in ((0.0, edge - 0.3), (0.02, edge - 0.1), (0.04, -edge + 0.1)):
        joints = tracker.update(_readings(time, (position, 0.0), (10.0, 0.0)))
    assert not tracker.jumped.any()
    assert tracker.wrapped.tolist() == [True, False]
    assert joints.position[0] == pytest.approx(-(edge + 0.1 - 0.5))
    tracker.update(_readings(0.06, (edge - 0.1, 0.0), (-10.0, 0.0)))
    assert not tracker.wrapped.any(), "back within reach of commands"


def test_a_jump_is_remembered(wiring: Wiring) -> None:
    tracker = JointTracker(wiring, np.zeros(2))
    tracker.update(_readings(0.0, (0.0, 0.0)))
    tracker.update(_readings(0.02, (0.0, 1.0)))
    tracker.update(_readings(0.04, (0.0, 1.0)))
    assert tracker.jumped.tolist() == [False, True]
