"""The guards of a robot: derived from its limits, or as its description gives them."""

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace

from humanoid_sim.assets import policy_path
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract_physics
from humanoid_sim.robots.guards import describe_unwatched, guards_of
from humanoid_sim.robots.schema import GuardSettings

LITE = load_robot("lite")
BIPED = load_robot("lite_biped")
ELBOW = LITE.joint_names.index("left_elbow_pitch")
ROLL = LITE.joint_names.index("left_wrist_roll")


def test_the_defaults_follow_from_the_limits():
    arms = guards_of(LITE)
    assert arms.following_effort[[ELBOW, ROLL]].tolist() == pytest.approx([11.2, 3.2])
    assert (arms.following_time, arms.following_progress, arms.limit_time, arms.speed_time) == (0.15, 0.02, 0.1, 0.02)
    assert (arms.following_within, arms.limit_margin.tolist()) == (False, [0.15] * 14)
    assert arms.speed_limit[ELBOW] == pytest.approx(2.35619 / 0.1)
    assert arms.speed_limit[LITE.joint_names.index("left_shoulder_roll")] == 0.99 * 33.0, "its motor reports no more"
    legs = guards_of(BIPED)
    assert (legs.following_time, legs.following_within) == (0.3, True), "legs have more time"
    assert legs.speed_limit[BIPED.joint_names.index("left_knee_pitch")] == pytest.approx(2.35619 / 0.05)
    assert legs.speed_limit[BIPED.joint_names.index("left_ankle_roll")] == 15.0


def test_legs_are_judged_by_their_own_limits_not_by_those_of_a_policy():
    contract = load_checkpoint(policy_path("lite_biped_velocity"), None, BIPED.joint_names).contract
    weak = dataclasses.replace(contract, effort_limit=np.full(len(contract.joint_names), 5.0))
    knee = BIPED.joint_names.index("left_knee_pitch")
    joints = [replace(joint, effort_limit=np.inf) if i == knee else joint for i, joint in enumerate(BIPED.joints)]
    robot = replace(BIPED, joints=tuple(joints))
    limited = with_contract_physics(robot, weak)
    assert limited.effort_limit.max() == 5.0
    assert guards_of(limited).following_effort.tolist() == guards_of(robot).following_effort.tolist()
    assert with_contract_physics(limited, weak) == limited
    assert RobotDescription.from_json(limited.to_json(), limited.folder) == limited


def test_guards_that_do_not_watch_a_joint_are_named():
    assert describe_unwatched(LITE) == describe_unwatched(BIPED) == ""
    bare = replace(BIPED.joints[0], lower=-np.inf, upper=np.inf, effort_limit=np.inf)
    robot = replace(BIPED, joints=(bare, *BIPED.joints[1:]), guards=GuardSettings(speed=None))
    assert np.isinf(guards_of(robot).following_effort).tolist() == [True] + [False] * 13
    text = describe_unwatched(robot)
    assert "following is off for 1 of 14 joints" in text
    assert "limit is off for 1 of 14 joints" in text
    assert "speed is off for 14 of 14 joints" in text


def test_the_description_decides():
    given = GuardSettings(following=0.5, following_time=1.0, limit=None, speed=(3.0,) * 14)
    guards = guards_of(replace(LITE, guards=given))
    assert (guards.following_effort[ELBOW], guards.following_time) == (7.0, 1.0)
    assert np.isinf(guards.limit_margin).all()
    assert guards.speed_limit.tolist() == [3.0] * 14
    assert guards_of(replace(LITE, guards=GuardSettings(following=None, limit=None, speed=None))) is None
