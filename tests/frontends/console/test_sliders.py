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


def joint_of(robot, **changes):
    """The robot with another elbow."""
    joints = list(robot.joints)
    joints[ELBOW] = msgspec.structs.replace(joints[ELBOW], **changes)
    return msgspec.structs.replace(robot, joints=tuple(joints))


def test_the_bounds_are_the_robots():
    assert SLIDERS.bounds(ELBOW, -1.7) == Bounds(
        position=(-2.35619, 0.0),
        velocity=(-3.0, 3.0),
        effort=(-14.0, 14.0),
        stiffness=(0.0, 100.0),  # twice STANDBY's
        damping=(0.0, 5.0),  # all that an rs-00 can be told
    )


def test_bounds_of_a_joint_without_limits_motor_or_effort_limit():
    wheel = joint_of(LITE, lower=-math.inf, upper=math.inf, effort_limit=math.inf, motor=None)
    bounds = Sliders(wheel).bounds(ELBOW, 10.0)
    assert bounds.position == pytest.approx((10.0 - math.pi, 10.0 + math.pi))
    assert bounds.effort == (0.0, 0.0)
    assert bounds.damping == (0.0, 10.0)  # twice the passive hold's


def test_a_slow_joint_is_commanded_at_half_its_limit():
    speed = msgspec.structs.replace(LITE.guards.speed, limit=(2.0,) * LITE.joint_count)
    slow = msgspec.structs.replace(LITE, guards=msgspec.structs.replace(LITE.guards, speed=speed))
    assert Sliders(slow).bounds(ELBOW, 0.0).velocity == (-1.0, 1.0)


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


def test_the_gains_of_the_other_standby():
    standby = msgspec.structs.replace(LITE.standby_controller_b, target_stiffness=(20.0,) * LITE.joint_count)
    sliders = Sliders(msgspec.structs.replace(LITE, standby_controller_b=standby), "b")
    state = sliders.begin(ELBOW, POSE)
    for _ in range(100):
        state = sliders.step(state, POSE, STILL, PERIOD)
    assert of(state, 0)[3] == 20.0


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


def test_snap_to_measured():
    state = stepped(SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(-1.5, 1.0, 2.0, 40.0, 2.0)), 2.0)
    assert of(state) == [-1.525, 1.0, 2.0, 40.0, 2.0]  # 7 N·m over 40 N·m/rad from the joint
    position = POSE.copy()
    position[ELBOW] = -1.6
    state = SLIDERS.snap(state, position)
    assert state.goals == Goals(-1.6)
    state = SLIDERS.step(state, position, STILL, PERIOD)
    assert of(state) == [-1.6, 0.94, 1.72, 38.0, 1.9]  # where it is, at once; the rest gradually
    assert of(stepped(state, 2.0, position)) == [-1.6, 0.0, 0.0, 0.0, 0.0]


def test_another_joint_is_chosen_and_the_first_one_held_where_it_is():
    state = stepped(SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(-1.5, stiffness=100.0, effort=2.0)), 2.0)
    position = POSE.copy()
    position[ELBOW] = -1.62
    state = SLIDERS.choose(state, 0, position)
    assert state.goals == Goals(0.3)
    state = SLIDERS.step(state, position, STILL, PERIOD)
    assert of(state, ELBOW)[2:4] == [1.72, 99.0]
    state = stepped(state, 3.0, position)
    assert of(state, ELBOW) == [-1.62, 0.0, 0.0, 50.0, 2.0]
    assert of(state, 0) == [0.3, 0.0, 0.0, 0.0, 0.0]


def test_after_a_gap_it_begins_as_passive_and_goes_to_the_same_goals():
    state = stepped(SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(-1.6, stiffness=40.0)), 2.0)
    sagged = POSE + 0.05
    state = SLIDERS.again(state, sagged)
    assert of(state) == [-1.65, 0.0, 0.0, 0.0, 5.0]
    assert of(state, 0) == [0.35, 0.0, 0.0, 0.0, 5.0]
    state = stepped(state, 2.0, sagged)
    assert of(state) == [-1.6, 0.0, 0.0, 40.0, 0.0]
    assert of(state, 0) == [0.3, 0.0, 0.0, 50.0, 2.0]


def test_a_velocity_that_leads_out_slows_down_on_the_way_to_the_limit():
    state = stepped(SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(-1.7, velocity=3.0, damping=2.0)), 2.0)
    for at, commanded in ((-1.0, 3.0), (-0.25, 1.0), (0.0, 0.0), (0.1, 0.0)):
        position = POSE.copy()
        position[ELBOW] = at
        assert of(SLIDERS.step(state, position, STILL, PERIOD))[1] == commanded


def test_an_effort_does_not_make_a_fast_joint_faster():
    state = stepped(SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(-1.7, effort=10.0)), 2.0)
    for speed, commanded in ((0.0, 10.0), (3.0, 10.0), (4.5, 5.0), (6.0, 0.0), (20.0, 0.0), (-20.0, 10.0)):
        velocity = STILL.copy()
        velocity[ELBOW] = speed
        assert of(SLIDERS.step(state, POSE, velocity, PERIOD))[2] == commanded
    velocity = np.full(LITE.joint_count, np.nan)
    assert of(SLIDERS.step(state, POSE, velocity, PERIOD))[2] == 10.0


def test_time_that_jumps_moves_nothing_far():
    state = SLIDERS.wish(SLIDERS.begin(ELBOW, POSE), Goals(0.0))
    assert of(SLIDERS.step(state, POSE, STILL, 1000.0))[0] == -1.65  # as in 0.05 s
    assert of(SLIDERS.step(state, POSE, STILL, -1.0))[0] == -1.7


def test_a_robot_whose_standby_holds_nothing_has_no_sliders():
    none = replace_standby(LITE, (0.0,) * LITE.joint_count)
    with pytest.raises(FieldError, match="sliders: STANDBY of lite has no K_p"):
        Sliders(none)


def replace_standby(robot, stiffness):
    standby = msgspec.structs.replace(robot.standby_controller_a, target_stiffness=stiffness)
    return msgspec.structs.replace(robot, standby_controller_a=standby)


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
