"""Check poses: those of the shipped robots are harmless, and harmful ones are refused."""

import pytest
from msgspec.structs import replace

from humanoid_sim.assets import shipped
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot, with_check_poses
from humanoid_sim.simulation.check_poses import check_pose_problems

CHECKED = [name for name in shipped("robots") if load_robot(name).check_poses]


def test_some_robots_have_them():
    assert CHECKED == ["lite", "lite_biped", "lite_sito"]


@pytest.mark.parametrize("name", CHECKED)
def test_those_of_shipped_robots_are_harmless_with_any_single_fault(name):
    assert list(check_pose_problems(load_robot(name))) == []


BEYOND, FEET = "beyond its limits,", "left_foot and right_foot touch, or did so on the way there"


@pytest.mark.parametrize(
    ("name", "pose", "problem"),
    [
        ("lite", {"left_elbow_pitch": -0.6}, f"left_elbow_pitch would be at 0.60 rad mirrored, {BEYOND} -2.35619 to 0"),
        ("lite", {"left_wrist_yaw": 1.4}, f"left_wrist_yaw would be at 1.80 rad off by +0.4 rad, {BEYOND} "),
        ("lite_biped", {"left_hip_roll": -0.1}, "left_hip_roll would be at -0.50 rad off by -0.4 rad"),
        ("lite_biped", {"left_hip_yaw": 0.3, "right_hip_yaw": -0.3}, f"{FEET}, with left_hip_roll mirrored"),
    ],
)
def test_a_harmful_one_is_refused(name, pose, problem):
    robot = replace(load_robot(name), check_poses=(pose,))
    found = list(check_pose_problems(robot))
    assert any(line.startswith(f"check_poses[0]: {problem}") for line in found), found


def test_the_way_back_counts_too():
    legs = load_robot("lite_biped")
    robot = replace(legs, check_poses=legs.check_poses[:2])
    assert next(check_pose_problems(robot)).startswith("check_poses, on the way back: left_foot and right_foot touch")


def test_standby_walks_through_them_slowly_and_back():
    robot = load_robot("lite")
    for before, after in zip(
        (robot.standby_controller_a, robot.standby_controller_b),
        (with_check_poses(robot).standby_controller_a, with_check_poses(robot).standby_controller_b),
        strict=True,
    ):
        assert after.pose_segments[-1] == before.pose_segments[-1]
        assert after.pose_segments[:2] == before.pose_segments
        ways = zip(after.pose_segments[1:], after.pose_segments[2:], after.segment_durations[2:], strict=False)
        speeds = [max(abs(a - b) for a, b in zip(start, end, strict=True)) / time for start, end, time in ways]
        assert max(speeds) <= 0.5
        assert sum(speed == 0.0 for speed in speeds) == 3, "each pose is held"


def test_a_robot_without_is_refused():
    with pytest.raises(InputError, match=r"^--check-poses: 'lite_neck' has none, expected check_poses in its YAML"):
        with_check_poses(load_robot("lite_neck"))
