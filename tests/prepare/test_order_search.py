"""A motion in the wrong order is refused, and the message says which order would fit."""

from dataclasses import replace

import numpy as np
import pytest
from motion_samples import lite, source_of

from humanoid_sim.prepare.acceptance import what_would_fit
from humanoid_sim.prepare.conventions import Conventions
from humanoid_sim.prepare.motion_fit import Tolerance
from humanoid_sim.prepare.skeleton import Skeleton

SKELETON = Skeleton(lite())
TOLERANCE = Tolerance(0.01, np.radians(2.0))


def with_columns(motion, joints=None, bodies=None, xyzw=False):
    """The same motion with its columns in another order."""
    position = motion.joint_position if joints is None else motion.joint_position[:, joints]
    place = motion.body_position if bodies is None else motion.body_position[:, bodies]
    turn = motion.body_quaternion if bodies is None else motion.body_quaternion[:, bodies]
    turn = np.roll(turn, -1, axis=-1) if xyzw else turn
    return replace(motion, joint_position=position, joint_velocity=None, body_position=place, body_quaternion=turn)


def fit(motion, bodies=SKELETON.bodies):
    conventions = Conventions(SKELETON.joints, bodies, "wxyz")
    return what_would_fit(motion, conventions, SKELETON, TOLERANCE)


def places(order, of):
    return [of.index(name) for name in order]


BREADTH_JOINTS = places(SKELETON.joint_orders["breadth_first"], SKELETON.joints)
BREADTH_BODIES = places(SKELETON.body_orders["breadth_first"], SKELETON.bodies)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"xyzw": True}, "--quaternions xyzw"),
        ({"joints": BREADTH_JOINTS}, "--joint-order breadth_first"),
        ({"bodies": BREADTH_BODIES}, "--body-order breadth_first"),
        (
            {"joints": BREADTH_JOINTS, "bodies": BREADTH_BODIES},
            "--joint-order breadth_first --body-order breadth_first",
        ),
        (
            {"joints": BREADTH_JOINTS, "bodies": BREADTH_BODIES, "xyzw": True},
            "--joint-order breadth_first --body-order breadth_first --quaternions xyzw",
        ),
    ],
)
def test_orders_with_a_name(changes, words):
    assert fit(with_columns(source_of(SKELETON.bodies), **changes)) == f"it would fit with {words}"


def test_the_motion_of_another_robot():
    motion = source_of(SKELETON.bodies)
    noise = 0.5 * np.random.default_rng(0).normal(size=motion.joint_position.shape)
    assert fit(replace(motion, joint_position=motion.joint_position + noise)) == ""
