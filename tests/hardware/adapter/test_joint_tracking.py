"""The joints' state from what motors report, and which turn a motor is on."""

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.adapter.joint_tracking import JointTracker, find_turns, has_jumped, turn_problems, unwrapped
from humanoid_sim.hardware.adapter.wiring import make_wiring
from humanoid_sim.hardware.motors import Readings
from humanoid_sim.robots.description import load_robot

WRAP = 8.0 * math.pi
"""rad, with which a Robstride motor's reports repeat."""


@pytest.fixture
def wiring(description):
    return make_wiring(description, 2, {"left": 0.5, "right": -1.0})


def _readings(time, position, velocity=(0.0, 0.0)):
    pair = np.array
    return Readings(np.full(2, time), pair(position), pair(velocity), pair([1.0, 2.0]), np.full(2, 25.0))


def test_direction_offset_and_turns_make_the_joint_frame(wiring):
    tracker = JointTracker(wiring, np.array([0.0, -1.0]))
    joints = tracker.update(_readings(1.0, (0.75, 2.0 * math.pi), (3.0, 4.0)))
    assert joints.position.tolist() == pytest.approx([-0.25, 1.0])
    assert joints.velocity.tolist() == [-3.0, 4.0]
    assert joints.effort.tolist() == [-1.0, 2.0]
    assert joints.time.tolist() == [1.0, 1.0]


def test_on_an_unknown_turn_a_position_is_unknown(wiring):
    joints = JointTracker(wiring, np.array([np.nan, 0.0])).update(_readings(1.0, (0.75, 0.0)))
    assert math.isnan(joints.position[0])
    assert joints.velocity[0] == 0.0
    assert math.isfinite(joints.position[1])


def test_a_motor_that_turns_beyond_its_report_is_followed_and_noticed(wiring):
    tracker = JointTracker(wiring, np.zeros(2))
    edge = 4.0 * math.pi
    for time, position in ((0.0, edge - 0.3), (0.02, edge - 0.1), (0.04, -edge + 0.1)):
        joints = tracker.update(_readings(time, (position, 0.0), (10.0, 0.0)))
    assert not tracker.jumped.any()
    assert tracker.wrapped.tolist() == [True, False]
    assert joints.position[0] == pytest.approx(-(edge + 0.1 - 0.5))
    tracker.update(_readings(0.06, (edge - 0.1, 0.0), (-10.0, 0.0)))
    assert not tracker.wrapped.any(), "back within reach of commands"


TURN = 2.0 * math.pi


_lite = load_robot("lite")
LITE = make_wiring(_lite, 2, dict.fromkeys(_lite.joint_names, 0.0))


@given(st.data())
def test_whatever_the_power_on_angle_the_joint_is_found_where_it_is(data):
    joint = np.array(
        [data.draw(st.floats(low - 0.3, high + 0.3)) for low, high in zip(LITE.lower, LITE.upper, strict=True)]
    )
    offset = np.array(data.draw(st.lists(st.floats(-1.5, 1.5), min_size=14, max_size=14)))
    symmetric = data.draw(st.booleans())  # zero_sta: the first position lies in 0..2π or in -π..π
    raw = LITE.direction * joint + offset
    reported = (raw + math.pi) % TURN - math.pi if symmetric else raw % TURN
    shifted = dataclasses.replace(LITE, offset=offset)
    turns = find_turns(shifted, reported)
    found = shifted.direction * (reported + TURN * turns - offset)
    np.testing.assert_allclose(found, joint, atol=1e-9)


def test_a_joint_that_may_be_on_two_turns_is_a_problem(description):
    wide = msgspec.structs.replace(description.joints[0], lower=-3.1, upper=3.1)
    shifted = make_wiring(
        msgspec.structs.replace(description, joints=(wide, description.joints[1])), 2, {"left": 0.0, "right": 0.0}
    )
    position = np.array([3.0, 0.0])
    turns = find_turns(shifted, position)
    assert np.isnan(turns[0])
    assert dict(turn_problems(shifted, position, turns)) == {
        "left": "may be on more than one turn: its range, -3.1 to 3.1 rad, is almost a whole one"
    }


def test_a_joint_without_limits_is_where_it_says(description):
    wheel = msgspec.structs.replace(description.joints[0], lower=-math.inf, upper=math.inf)
    shifted = make_wiring(
        msgspec.structs.replace(description, joints=(wheel, description.joints[1])), 2, {"left": 0.0, "right": 0.0}
    )
    position = np.array([5.0, 0.0])
    assert find_turns(shifted, position).tolist() == [0.0, 0.0]
    assert list(turn_problems(shifted, position, np.zeros(2))) == []


def test_a_range_that_commands_cannot_reach_is_a_problem(description):
    shifted = make_wiring(description, 2, {"left": 12.0, "right": 0.0})
    position = np.array([11.5, 0.0])
    turns = find_turns(shifted, position)
    assert turns[0] == 0.0
    ((joint, text),) = turn_problems(shifted, position, turns)
    assert joint == "left"
    assert "commands reach ±12.57" in text


def test_a_joint_that_was_not_heard_is_a_problem(wiring):
    position = np.array([np.nan, 0.0])
    assert dict(turn_problems(wiring, position, find_turns(wiring, position)))["left"] == "has not told its position"


@given(st.floats(-60.0, 60.0), st.floats(-3.0, 3.0))
def test_a_wrapped_position_is_continued(previous, step):
    there = previous + step
    reported = (there + 0.5 * WRAP) % WRAP - 0.5 * WRAP
    assert unwrapped(np.array([reported]), np.array([previous]), np.array([WRAP]))[0] == pytest.approx(there, abs=1e-9)


def test_without_a_previous_position_the_reported_one_counts():
    result = unwrapped(np.array([1.0, np.nan]), np.array([np.nan, 2.0]), np.array([WRAP, WRAP]))
    assert result[0] == 1.0
    assert np.isnan(result[1])


def _jumped(moved, elapsed, velocity, previous=0.0, fastest=33.0):
    arrays = (np.array([value]) for value in (moved, elapsed, velocity, previous, fastest))
    return bool(has_jumped(*arrays)[0])


@pytest.mark.parametrize(
    ("moved", "elapsed", "velocity", "previous", "jumped"),
    [
        (0.0, 0.02, 0.0, 0.0, False),
        (0.2, 0.02, 10.0, 10.0, False),
        (-0.2, 0.002, 10.0, 10.0, False),  # two frames changed places
        (0.14, 0.02, 0.0, 0.0, False),
        (0.16, 0.02, 0.0, 0.0, True),
        (0.08, 0.01, 0.0, 0.0, True),
        (-0.5, 0.02, 0.1, 0.0, True),
        (1.0, 0.02, 10.0, 10.0, True),
        (0.0, 0.02, 8.0, -8.0, False),  # thrown back by a stop
        (0.1, 0.02, 4.0, 0.0, False),  # accelerated within the period
        (5.0, 0.3, 0.0, 0.0, False),  # a silence in which anything may have happened
        (12.0, 0.3, 0.0, 0.0, True),  # but nothing that fast
        (0.0, float("nan"), 0.0, 0.0, False),
    ],
)
def test_what_no_velocity_explains_is_a_jump(moved, elapsed, velocity, previous, jumped):
    assert _jumped(moved, elapsed, velocity, previous) is jumped
