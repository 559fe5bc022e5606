"""A policy's gains and default pose in a robot's description."""

import numpy as np
import pytest
from models import contract_of

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot, with_contract, with_contract_physics, with_joint_limits

ROBOT = load_robot("lite_biped")
N = ROBOT.joint_count


def contract(joints, **fields):
    n = len(joints)
    values = {
        "joint_stiffness": np.arange(n) + 10.0,
        "joint_damping": np.arange(n) * 0.1,
        "default_joint_pos": np.arange(n) * 0.01,
        "observation": ("joint_pos",),
        "action_scale": 0.25,
    }
    return contract_of(joints, **{**values, **fields})


def test_gains_and_pose_arrive_in_the_robots_order():
    backwards = ROBOT.joint_names[::-1]
    robot = with_contract(ROBOT, contract(backwards, default_joint_pos=np.where(np.arange(N) == 10, 0.3, 0.0)))
    assert robot.stiffness.tolist() == (np.arange(N) + 10.0)[::-1].tolist()
    assert robot.damping.tolist() == (np.arange(N) * 0.1)[::-1].tolist()
    assert backwards[10] == "left_knee_pitch"
    assert robot.initial_position == tuple(0.3 if name == "left_knee_pitch" else 0.0 for name in robot.joint_names)
    for standby in (robot.standby_controller_a, robot.standby_controller_b):
        assert standby.pose_segments == (robot.initial_position,)
        assert standby.target_stiffness == tuple(robot.stiffness)
        assert standby.target_damping == tuple(robot.damping)
        assert standby.segment_durations == (2.0,)
    assert robot.damping_controller.damping == tuple(robot.damping)
    assert robot.remote_policy_controller.damping == tuple(robot.damping)
    assert robot.joints[3].motor == ROBOT.joints[3].motor
    assert robot.stiffness.any()


def test_a_default_pose_beyond_a_limit_is_moved_to_it():
    pose = np.full(N, -0.01)  # a knee cannot go below 0
    robot = with_contract(ROBOT, contract(ROBOT.joint_names, default_joint_pos=pose))
    assert dict(zip(robot.joint_names, robot.initial_position, strict=True))["left_knee_pitch"] == 0.0
    assert robot.initial_position[0] == -0.01


def test_another_robots_contract_is_refused_by_name():
    names = (*ROBOT.joint_names[:-1], "tail")
    with pytest.raises(InputError) as caught:
        with_contract(ROBOT, contract(names))
    assert str(caught.value) == (
        "lite_biped: joint_names of the policy do not match the robot's joints: the robot lacks tail; "
        "the policy lacks right_ankle_roll"
    )


@pytest.mark.parametrize(("decision", "kept"), [("undecided", "keep"), ("keep", "keep"), ("drop", "drop")])
def test_what_becomes_of_the_models_own_damping(decision, kept):
    robot = with_contract(ROBOT, contract(ROBOT.joint_names, model_joint_damping=decision))
    assert robot.simulation.joint_damping == kept


def test_the_torque_limits_of_the_training_are_taken_as_far_as_they_are_lower():
    own = ROBOT.effort_limit
    backwards = ROBOT.joint_names[::-1]
    limits = np.full(N, np.inf)
    limits[0], limits[1] = 2.0, 1e6
    for with_limits in (with_contract, with_contract_physics):
        robot = with_limits(ROBOT, contract(backwards, effort_limit=limits))
        assert robot.effort_limit.tolist() == [*own[:-1].tolist(), 2.0]
    everywhere = with_contract(ROBOT, contract(backwards, effort_limit=3.0))
    assert everywhere.effort_limit.tolist() == np.minimum(own, 3.0).tolist()
    assert with_contract(ROBOT, contract(backwards)).effort_limit.tolist() == own.tolist()


def test_joint_limits_are_those_of_the_driven_joints():
    driven = (ROBOT.joint_names[4], ROBOT.joint_names[1])
    made = with_joint_limits(
        contract(ROBOT.joint_names, action_joint_names=driven, position_clip="joint_limits"), ROBOT
    )
    assert made.position_clip.tolist() == [[ROBOT.lower[4], ROBOT.upper[4]], [ROBOT.lower[1], ROBOT.upper[1]]]
    plain = contract(ROBOT.joint_names)
    assert with_joint_limits(plain, ROBOT) is plain
