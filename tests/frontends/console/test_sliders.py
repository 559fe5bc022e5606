"""The sliders' arithmetic: what it commands, whatever is asked for."""

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
    sliders = JointSliders(LITE, "a")
    sliders.choose(ELBOW, POSE)
    return sliders


def of(command, joint=ELBOW):
    """Position, K_p and K_d of a joint."""
    return [round(float(field[joint]), 9) for field in (command.position, command.stiffness, command.damping)]


def stepped(sliders, seconds, position=POSE):
    for _ in range(round(seconds / PERIOD)):
        command = sliders.step(position, PERIOD)
    return command


def test_it_begins_as_the_passive_hold_and_nothing_jumps(sliders):
    assert sliders.goals.tolist() == [-1.7, 0.0, 0.0]
    command = sliders.step(POSE, PERIOD)
    assert of(command) == [-1.7, 0.0, 4.95]  # K_d fades to the slider's 0
    assert of(command, 0) == [0.3, 1.0, 4.95]  # K_p comes in: 50 in a second
    command = stepped(sliders, 3.0)
    assert of(command) == [-1.7, 0.0, 0.0]
    assert of(command, 0) == [0.3, 50.0, 2.0]
    assert not command.effort.any()


def test_the_position_moves_at_a_limited_rate_and_stays_near_the_joint(sliders):
    sliders.goals[:2] = 0.0, 10.0
    assert of(sliders.step(POSE, PERIOD))[0] == -1.68  # 1 rad/s
    assert of(stepped(sliders, 3.0))[0] == -1.4  # no further than 0.3 rad, though the joint does not come


def test_a_stiff_spring_never_pulls_near_the_effort_limit(sliders):
    sliders.goals[:2] = 0.0, 100.0
    position, stiffness, _ = of(stepped(sliders, 4.0))
    assert stiffness == 100.0
    assert stiffness * (position + 1.7) == pytest.approx(7.0)  # half of 14 N·m


number = st.floats(-1e6, 1e6)


@given(
    goals=st.lists(st.tuples(number, number, number), min_size=1, max_size=6),
    joints=st.lists(st.integers(0, LITE.joint_count - 1), min_size=6, max_size=6),
    position=st.lists(st.floats(-4.0, 4.0), min_size=14, max_size=14),
    elapsed=st.floats(-1.0, 1e6),
)
def test_whatever_is_asked_for_no_field_jumps_or_leaves_its_limits(goals, joints, position, elapsed):
    measured, sliders = np.array(position), JointSliders(LITE, "a")
    before = np.zeros(LITE.joint_count)
    for goal, joint in zip(goals, joints, strict=False):
        sliders.choose(joint, measured)
        sliders.goals[:] = goal
        command = sliders.step(measured, elapsed)
        assert (command.stiffness >= 0.0).all()
        assert (command.stiffness <= 100.0).all()
        assert (command.damping >= 0.0).all()
        assert (command.damping <= 5.0).all()
        assert (np.abs(command.stiffness - before) <= 2.5 + 1e-9).all()
        before = command.stiffness
        spring = command.stiffness[joint] * abs(command.position[joint] - measured[joint])
        assert spring <= 0.5 * LITE.effort_limit[joint] + 1e-9
