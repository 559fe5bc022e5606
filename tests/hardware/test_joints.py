"""Joints and their motors: turns at power-on, angles that wrap or jump, and a command in the motor frame."""

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.joints import JointTracker, check_positions, make_wiring
from humanoid_sim.hardware.motor_link import Readings
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
TURN = 2.0 * math.pi
RANGE = 4.0 * math.pi


def wiring(offset=0.0):
    return make_wiring(LITE, 1, dict.fromkeys(LITE.joint_names, offset))


def readings(time, position, velocity=0.0):
    n = LITE.joint_count
    return Readings(np.full(n, time), np.full(n, position), np.full(n, velocity), np.zeros(n), np.full(n, 30.0))


@pytest.mark.parametrize(
    ("offset", "beyond", "wider", "part"),
    [
        (0.0, math.nan, 0.0, "has not reported"),
        (0.0, 1.0, 0.0, "on any turn: calibrate"),
        (0.0, 0.0, 4.0, "on more than one turn: move it"),
        (11.9, 0.0, 0.0, "needs commands"),
    ],
)
def test_a_joint_that_nobody_can_place_is_a_problem(offset, beyond, wider, part):
    """A joint beyond its limits on every turn is not calibrated, or turns the other way."""
    wired = wiring(offset)
    wired, checks = replace(wired, lower=wired.lower - wider), CheckList()
    i = LITE.joint_names.index("left_elbow_pitch")
    check_positions(wired, [i], wired.direction * (wired.upper + beyond) + wired.offset, checks)
    assert len(checks.problems) == 1
    assert "left_elbow_pitch" in checks.problems[0]
    assert part in checks.problems[0]


@pytest.mark.parametrize("numbers", [(0, 1), (1, 2), (0, 5)])
def test_channels_are_those_of_the_buses_in_the_order_of_their_numbers(numbers):
    moved = [msgspec.structs.replace(joint.motor, bus=numbers[joint.motor.bus]) for joint in LITE.joints]
    pairs = zip(LITE.joints, moved, strict=True)
    robot = msgspec.structs.replace(
        LITE, joints=tuple(msgspec.structs.replace(one, motor=motor) for one, motor in pairs)
    )
    assert [motor.channel for motor in make_wiring(robot, 2).motors] == [0] * 7 + [1] * 7
    with pytest.raises(InputError, match=f"3 channels given, .* buses {numbers[0]}, {numbers[1]}"):
        make_wiring(robot, 3)


STEPS = {
    "at rest": ([0.0, 0.02, -0.02], 0.0, False),
    "through the end of the range": ([RANGE - 0.02, RANGE - 0.001, -RANGE + 0.015], 1.0, False),
    "fast": ([0.0, 0.2, 0.4], 10.0, False),
    "a slip at rest": ([0.0, 0.0, 0.4], 0.0, True),
    "a whole turn": ([0.0, 0.0, TURN], 0.0, True),
    "faster than the motor": ([0.0, 4.0, 8.0], 200.0, True),
}


@pytest.mark.parametrize("name", STEPS)
def test_a_position_that_moved_as_no_motor_can_has_jumped(name):
    positions, velocity, jumps = STEPS[name]
    tracker = JointTracker(wiring(), np.zeros(LITE.joint_count))
    for k, position in enumerate(positions):
        tracker.update(readings(0.02 * k, position, velocity))
    assert tracker.jumped.all() == tracker.jumped.any() == jumps
    tracker.update(readings(0.1, positions[-1], 0.0))
    assert tracker.jumped.any() or not jumps, "it stays: the zero went with it"
