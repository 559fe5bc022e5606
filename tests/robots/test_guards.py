"""The guards of a robot: derived from its limits, or as its description gives them; and as a header keeps them."""

import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from humanoid_sim.assets import policy_path
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot, with_contract_physics
from humanoid_sim.robots.guards import GuardRecord, describe_unwatched, guards_of
from humanoid_sim.robots.schema import FollowingGuard, GuardSettings, RobotDescription, SpeedGuard
from humanoid_sim.testing import fingerprint

LITE = load_robot("lite")
BIPED = load_robot("lite_biped")
SAMPLE_LEGS = policy_path("lite_biped_velocity")
ELBOW = LITE.joint_names.index("left_elbow_pitch")
ROLL = LITE.joint_names.index("left_wrist_roll")


def of(robot):
    guards = guards_of(robot)
    assert guards is not None
    return guards


def test_the_defaults_follow_from_the_limits():
    arms = of(LITE)
    assert arms.following_effort[[ELBOW, ROLL]].tolist() == pytest.approx([11.2, 3.2])
    assert (arms.following_time, arms.following_progress, arms.limit_time, arms.speed_time) == (0.15, 0.02, 0.1, 0.02)
    assert arms.limit_margin.tolist() == [0.15] * 14
    assert arms.speed_limit[ELBOW] == pytest.approx(2.35619 / 0.1)
    assert arms.speed_limit[LITE.joint_names.index("left_shoulder_roll")] == 0.99 * 33.0, "its motor reports no more"


def test_a_speed_that_a_motor_cannot_report_is_too_fast():
    sito = load_robot("lite_sito")
    largest = 0.99 * 32767 / (65536 / (2 * np.pi))  # an int16, in counts/s
    for robot in (sito, replace(sito, guards=GuardSettings(speed=SpeedGuard(limit=(20.0,) * 14)))):
        assert of(robot).speed_limit[ROLL] == pytest.approx(largest) == pytest.approx(3.11, abs=0.001)
    joint = replace(LITE.joints[ROLL], lower=-2.0, upper=2.0, motor=replace(LITE.joints[ROLL].motor, model="rs-04"))
    robot = replace(LITE, joints=tuple(joint if i == ROLL else other for i, other in enumerate(LITE.joints)))
    assert of(robot).speed_limit[ROLL] == 0.99 * 15.0, "it turns at 20.9 rad/s without load"


def test_legs_are_given_more_time():
    legs = of(BIPED)
    assert (legs.following_time, legs.following_within) == (0.3, True)
    assert (of(LITE).following_time, of(LITE).following_within) == (0.15, False)
    assert legs.speed_limit[BIPED.joint_names.index("left_knee_pitch")] == pytest.approx(2.35619 / 0.05)
    assert legs.speed_limit[BIPED.joint_names.index("left_ankle_roll")] == 15.0


def test_legs_are_judged_by_their_own_limits_not_by_those_of_a_policy():
    contract = load_checkpoint(SAMPLE_LEGS, None, BIPED.joint_names).contract
    weak = dataclasses.replace(contract, effort_limit=np.full(len(contract.joint_names), 5.0))
    limited = with_contract_physics(BIPED, weak)
    assert limited.effort_limit.max() == 5.0
    assert of(limited).following_effort.tolist() == of(BIPED).following_effort.tolist()
    assert with_contract_physics(limited, weak) == limited
    knee = BIPED.joint_names.index("left_knee_pitch")
    joints = [replace(joint, effort_limit=np.inf) if i == knee else joint for i, joint in enumerate(BIPED.joints)]
    guards = of(with_contract_physics(replace(BIPED, joints=tuple(joints)), weak))
    assert np.flatnonzero(np.isinf(guards.following_effort)).tolist() == [knee]
    assert RobotDescription.from_json(limited.to_json(), limited.folder) == limited


def test_guards_that_are_off_are_named_with_the_reason():
    assert describe_unwatched(LITE) == describe_unwatched(BIPED) == ""
    bare = replace(BIPED.joints[0], lower=-np.inf, upper=np.inf, effort_limit=np.inf)
    robot = replace(BIPED, joints=(bare, *BIPED.joints[1:]), guards=GuardSettings(speed=None))
    assert describe_unwatched(robot) == (
        "guards: following is off for 1 of 14 joints, which lack an effort limit of the robot's own; "
        "limit is off for 1 of 14 joints, which lack position limits; speed is off, as the robot's description says"
    )
    off = GuardSettings(following=None, limit=None, speed=None)
    assert describe_unwatched(replace(BIPED, guards=off)) == "guards: all are off, as the robot's description says"


def test_a_joint_without_limits_and_motor_is_watched_by_what_is_known():
    bare = replace(LITE.joints[0], lower=-np.inf, upper=np.inf, effort_limit=np.inf, motor=None)
    robot = replace(LITE, joints=(bare, *LITE.joints[1:]))
    guards = of(robot)
    assert np.isinf([guards.following_effort[0], guards.speed_limit[0]]).all()
    assert np.isfinite(guards.following_effort[1:]).all()


def test_the_description_decides():
    settings = GuardSettings(
        following=FollowingGuard(effort_share=0.5, time=1.0), limit=None, speed=SpeedGuard(limit=(3.0,) * 14)
    )
    guards = of(replace(LITE, guards=settings))
    assert guards.following_effort[ELBOW] == 7.0
    assert guards.following_time == 1.0
    assert np.isinf(guards.limit_margin).all()
    assert guards.speed_limit.tolist() == [3.0] * 14
    assert guards.speed_assumed == ()
    assert guards_of(replace(LITE, guards=GuardSettings(following=None, limit=None, speed=None))) is None


def mine(folder, text):
    """The Lite's description with a text more."""
    shipped = Path(LITE.folder, "lite.yaml").read_text(encoding="utf-8")
    path = folder / "mine.yaml"
    path.write_text(shipped.replace("../mjcf/lite.xml", str(LITE.mjcf_path)) + f"\n{text}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("following: {effort_share: 0}", "following.effort_share: is 0.0, expected a finite number > 0"),
        ("limit: {margin: -1}", "limit.margin: is -1.0, expected a finite number > 0"),
        ("following: {effort: [1, null]}", "following.effort: has 2 values, expected 14, one per joint"),
        ("speed: {limit: [1, 2]}", "speed.limit: has 2 values, expected 14, one per joint"),
        ("speed: {limit: 3}", "speed.limit: is 3, expected a list"),
        ("force: null", " unknown field 'force'; known: following, limit, speed"),
    ],
)
def test_bad_parameters_are_one_line(tmp_path, text, expected):
    path = mine(tmp_path, f"guards: {{{text}}}")
    with pytest.raises(InputError) as caught:
        load_robot(path)
    assert str(caught.value) == f"{path}: guards{':' if expected[0] == ' ' else '.'}{expected}"


def test_a_yaml_turns_a_guard_off(tmp_path):
    assert np.isinf(of(load_robot(mine(tmp_path, "guards: {following: null}"))).following_effort).all()


def test_a_speed_limit_that_nobody_gave_is_marked():
    guards = of(BIPED)
    for i, name in enumerate(BIPED.joint_names):
        crossing = max((BIPED.upper[i] - BIPED.lower[i]) / 0.05, 15.0)
        assert (name in guards.speed_assumed) == (guards.speed_limit[i] == crossing)
    robot = replace(LITE, joints=tuple(replace(joint, motor=None) for joint in LITE.joints))
    assert of(robot).speed_assumed == robot.joint_names


def test_a_header_s_document_gives_the_same_guards_again():
    for robot in (LITE, BIPED, replace(LITE, guards=GuardSettings(following=None))):
        guards = of(robot)
        text = msgspec.json.encode(GuardRecord.of(guards))
        again = msgspec.json.decode(text, type=GuardRecord).on(robot)
        assert fingerprint(again) == fingerprint(guards)
    with pytest.raises(FieldError, match="expected 14 numbers, one per joint"):
        GuardRecord.of(of(load_robot("lite_neck"))).on(LITE)


def test_a_description_says_of_its_guards_what_is_not_the_default():
    assert "guards" not in LITE.to_json(), "digests of baselines are those of before there were any"
    other = replace(LITE, guards=GuardSettings(limit=None))
    assert RobotDescription.from_json(other.to_json(), other.folder) == other
