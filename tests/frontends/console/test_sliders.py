"""The sliders' arithmetic: what it commands, whatever is asked for."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.console.sliders import Bounds, Goals, Sliders
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
SLIDERS = Sliders(LITE)
ELBOW = LITE.joint_names.index("left_elbow_pitch")
POSE = np.array(LITE.standby_controller_a.pose_segments[-1])
STILL = np.zeros(LITE.joint_count)
PERIOD = 0.02


def of(state, joint=ELBOW):
    """The five fields that a joint is commanded."""
    return [round(float(getattr(state.command, name)[joint]), 9) for name in COMMAND_FIELDS]


def stepped(state, seconds, position=POSE):
    for _ in range(round(seconds / PERIOD)):
        state = SLIDERS.step(state, position, STILL, PERIOD)
    return state


def test_the_bounds_are_the_robots():
    assert SLIDERS.bounds(ELBOW, -1.7) == Bounds(
        position=(-2.35619, 0.0),
        velocity=(-3.0, 3.0),
        effort=(-14.0, 14.0),
        stiffness=(0.0, 100.0),  # twice STANDBY's
        damping=(0.0, 5.0),  # all that an rs-00 can be told
    )


def test_it_begins_as_the_passive_hold_and_nothing_jumps():
    state = SLIDERS.begin(ELBOW, POSE)
    assert of(state) == [-1.7, 0.0, 0.0, 0.0, 5.0]
    assert state.goals == Goals(-1.7)
    state = SLIDERS.step(state, POSE, STILL, PERIOD)
    assert of(state) == [-1.7, 0.0, 0.0, 0.0, 4.9]  # K_d fades to the slider's 0
    assert of(state, 0) == [0.3, 0.0, 0.0, 1.0, 4.9]  # K_p comes in: 50 in a second
    state = stepped(state, 2.0)
    assert of(state) == [-1.7, 0.0, 0.0, 0.0, 0.0]
    assert of(state, 0) == [0.3, 0.0, 0.0, 50.0, 2.0]
    assert state.command.position.tolist() == POSE.tolist()


def test_the_position_moves_at_a_limited_rate_and_stays_near_the_joint():
    state = SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(0.0, stiffness=10.0))
    state = SLIDERS.step(state, POSE, STILL, PERIOD)
    assert of(state)[0] == -1.68  # 1 rad/s
    assert of(stepped(state, 3.0))[0] == -1.4  # no further than 0.3 rad, though the joint does not come
    position = POSE.copy()
    position[ELBOW] = -0.2
    assert of(stepped(state, 3.0, position))[0] == 0.0


def test_a_stiff_spring_never_pulls_near_the_effort_limit():
    state = SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(0.0, stiffness=100.0))
    state = stepped(state, 3.0)
    position, _, _, stiffness, _ = of(state)
    assert stiffness == 100.0
    assert stiffness * (position + 1.7) == pytest.approx(7.0)  # half of 14 N·m


def test_goals_beyond_the_bounds_are_bounded():
    state = SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(9.0, -90.0, 1e300, 1e300, -1.0))
    assert state.goals == Goals(0.0, -3.0, 14.0, 100.0, 0.0)
    assert SLIDERS.wish(state, Goals(-9.0)).goals.position == -2.35619


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "1", None, True])
@pytest.mark.parametrize("name", COMMAND_FIELDS)
def test_a_goal_that_is_no_finite_number_is_refused(name, value):
    state = SLIDERS.begin(ELBOW, POSE)
    with pytest.raises(FieldError, match=rf"sliders: {name} is .*, expected a finite number"):
        SLIDERS.wish(state, msgspec.structs.replace(Goals(-1.7), **{name: value}))


finite = st.floats(-1e6, 1e6)


@given(
    goals=st.lists(st.builds(Goals, finite, finite, finite, finite, finite), min_size=1, max_size=6),
    joints=st.lists(st.integers(0, LITE.joint_count - 1), min_size=6, max_size=6),
    position=st.lists(st.floats(-4.0, 4.0), min_size=14, max_size=14),
    elapsed=st.floats(-1.0, 1e6),
)
def test_whatever_is_asked_for_no_field_jumps_or_leaves_its_bounds(goals, joints, position, elapsed):
    measured = np.array(position)
    state = SLIDERS.begin(joints[0], measured)
    for goal, joint in zip(goals, joints, strict=False):
        state = SLIDERS.wish(SLIDERS.choose(state, joint, measured), goal)
        before = state.fields
        state = SLIDERS.step(state, measured, STILL, elapsed)
        command = state.command
        assert all(np.isfinite(getattr(command, name)).all() for name in COMMAND_FIELDS)
        assert (np.abs(command.effort) <= LITE.effort_limit).all()
        assert (np.abs(command.velocity) <= 3.0).all()
        assert (command.stiffness >= 0.0).all()
        assert (command.stiffness <= 100.0).all()
        assert (command.damping >= 0.0).all()
        assert (command.damping <= 5.0).all()
        assert (np.abs(state.fields - before)[1:].T <= [0.15 + 1e-9, 0.85 + 1e-9, 5.0 + 1e-9, 0.25 + 1e-9]).all()
        spring = command.stiffness[joint] * abs(command.position[joint] - measured[joint])
        assert spring <= 0.5 * LITE.effort_limit[joint] + 1e-9
