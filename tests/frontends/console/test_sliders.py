"""The sliders' arithmetic: what it commands, whatever is requested."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.frontends.console.sliders import JointSliders
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
ELBOW = LITE.joint_names.index("left_elbow_pitch")
POSE = np.array(LITE.standby_controller_a.pose_segments[-1])
PERIOD = 0.02


@pytest.fixture
def sliders():
    return JointSliders(LITE, POSE)


def of(command, joint=ELBOW):
    """Position, K_p and K_d of a joint."""
    return [round(float(field[joint]), 9) for field in (command.position, command.stiffness, command.damping)]


def stepped(sliders, seconds, position=POSE):
    for _ in range(round(seconds / PERIOD)):
        command = sliders.step(position, PERIOD)
    return command


def test_it_begins_as_the_passive_hold_and_nothing_jumps(sliders):
    assert of(sliders.step(POSE, PERIOD)) == [-1.7, 1.0, 4.9]
    command = stepped(sliders, 3.0)
    assert of(command) == [-1.7, 50.0, 2.0]
    assert not command.effort.any()


def test_a_joint_moves_at_a_limited_rate_and_is_led_by_half_its_effort_at_most(sliders):
    sliders.goals[ELBOW] = 0.0
    assert of(sliders.step(POSE, PERIOD))[0] == -1.68  # 1 rad/s
    assert of(stepped(sliders, 3.0))[0] == -1.58  # no further than 0.14 rad, which are half of 14 N·m
    sliders.goals[ELBOW] = -5.0
    command = stepped(sliders, 3.0, np.where(np.arange(14) == ELBOW, LITE.lower, POSE))
    assert of(command)[0] == pytest.approx(LITE.lower[ELBOW]), "no further than the joint's limit"


number = st.floats(-1e6, 1e6)


@given(
    goals=st.lists(st.lists(number, min_size=14, max_size=14), min_size=1, max_size=6),
    position=st.lists(st.floats(-4.0, 4.0), min_size=14, max_size=14),
    elapsed=st.floats(-1.0, 1e6),
)
def test_whatever_is_requested_no_field_jumps_or_pulls_hard(goals, position, elapsed):
    measured = np.array(position)
    sliders = JointSliders(LITE, measured)
    before, stiffness = measured, np.zeros(14)
    for goal in goals:
        sliders.goals[:] = goal
        command = sliders.step(measured, elapsed)
        assert (np.abs(command.position - before) <= 0.05 + 1e-9).all()
        assert (np.abs(command.stiffness - stiffness) <= 2.5 + 1e-9).all()
        assert ((command.damping >= 2.0) & (command.damping <= 5.0)).all()
        spring = command.stiffness * np.abs(command.position - measured)
        assert (spring <= 0.5 * LITE.effort_limit + 1e-9).all()
        before, stiffness = command.position, command.stiffness
