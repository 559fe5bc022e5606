import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.prepare.conventions import match_names, named_order


def test_an_order_by_name_or_by_names():
    known = {"robot": ("a", "b")}
    assert named_order("--joint-order", "robot", known) == ("a", "b")
    assert named_order("--joint-order", "b, a", known) == ("b", "a")
    with pytest.raises(InputError, match="--joint-order: is 'isaac', expected robot, or names"):
        named_order("--joint-order", "isaac", known)


def test_matching_names():
    assert match_names("a.csv", "joint", ("x", "y"), ("y",), "the robot") == [1]
    with pytest.raises(InputError, match=r"a\.csv: unknown joint 'z'; known: x, y \(the robot needs it\)"):
        match_names("a.csv", "joint", ("x", "y"), ("z",), "the robot")
