"""What a run took of each joint, and what is said where no limit is known."""

from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.evaluation.joint_use import JointUse, describe_effort
from humanoid_sim.testing import healthy_state

NAMES = ("hip", "knee", "foot")
INF = np.inf


def state(position, velocity, effort):
    return replace(
        healthy_state([0.0, 0.0, 0.0]),
        joint_position=np.array(position),
        joint_velocity=np.array(velocity),
        joint_effort=np.array(effort),
    )


def used(limits, upper=(1.0, 1.0, INF)):
    use = JointUse(NAMES, np.array(limits), np.array([-1.0, -1.0, -INF]), np.array(upper))
    use.update(state([0.0, 0.5, 9.0], [1.0, -3.0, 0.0], [30.0, -8.0, np.nan]))
    use.update(state([-0.5, 0.25, 7.0], [-2.0, 0.0, np.nan], [-40.0, 1.0, 12.5]))
    return use


def test_the_greatest_of_each_joint():
    hip, knee, foot = used([88.0, 10.0, INF]).rows()
    assert (hip["joint"], hip["speed"], hip["effort"], hip["effort_limit"]) == ("hip", 2.0, 40.0, 88.0)
    assert (hip["lowest"], hip["highest"], hip["range_share"]) == (-0.5, 0.0, 0.25)
    assert (knee["speed"], knee["effort"], knee["range_share"]) == (3.0, 8.0, 0.125)
    assert (foot["speed"], foot["effort"], foot["effort_limit"], foot["range_share"]) == (0.0, 12.5, None, None)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ([40.0, 10.0, 50.0], "40.0 of 40 N·m at hip, 1 ticks at an effort limit"),
        ([88.0, INF, INF], "NO EFFORT LIMIT KNOWN for 2 of 3 joints, at most 12.5 N·m at foot"),
    ],
)
def test_the_joint_closest_to_its_limit_is_named_and_a_missing_limit_is_said(limits, expected):
    assert expected in describe_effort(used(limits).effort())
