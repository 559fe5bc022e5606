import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.skeleton import Skeleton, match_names, named_order
from humanoid_sim.robots.description import load_robot


def test_orders_of_the_lite() -> None:
    skeleton = Skeleton(load_robot("lite"))
    assert skeleton.base == skeleton.bodies[0] == "chest"
    assert skeleton.joint_order("robot") == skeleton.joint_order("mjcf") == load_robot("lite").joint_names
    assert skeleton.joint_order("breadth_first")[:4] == (
        "left_shoulder_pitch",
        "right_shoulder_pitch",
        "left_shoulder_roll",
        "right_shoulder_roll",
    )
    breadth_first = skeleton.body_order("breadth_first")
    assert breadth_first[:4] == ("chest", "left_shoulder_pitch", "right_shoulder_pitch", "neck_yaw")
    assert sorted(breadth_first) == sorted(skeleton.bodies)


def test_links_of_the_lite() -> None:
    link = Skeleton(load_robot("lite")).links["left_shoulder_roll"]
    assert link.parent == "left_shoulder_pitch"
    assert [hinge.name for hinge in link.hinges] == ["left_shoulder_roll"]


def test_an_order_by_name_or_by_names() -> None:
    known = {"robot": ("a", "b")}
    assert named_order("--joint-order", "robot", known) == ("a", "b")
    assert named_order("--joint-order", "b, a", known) == ("b", "a")
    with pytest.raises(InputError, match="--joint-order: is 'isaac', expected robot, or names"):
        named_order("--joint-order", "isaac", known)


def test_matching_names() -> None:
    assert match_names("a.csv", "joint", ("x", "y"), ("y",), "the robot") == [1]
    with pytest.raises(InputError, match=r"a\.csv: unknown joint 'z'; known: x, y \(the robot needs it\)"):
        match_names("a.csv", "joint", ("x", "y"), ("z",), "the robot")
