"""From raw actions to joint positions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import JOINTS, contract

from humanoid_sim.controllers.action import action_command, resolve_action
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import COMMAND_FIELDS


def test_positions_by_name():
    command = action_command(resolve_action(contract(), JOINTS), np.array([1.0, 2.0], dtype=np.float32))
    # shoulder: second action, default 0.03, scale 0.25; elbow: first action, default 0.02, scale 0.5; wrist: pinned
    assert command.position.tolist() == [0.03 + 0.25 * 2.0, 0.02 + 0.5 * 1.0, 0.0]
    assert command.stiffness.tolist() == [33.0, 32.0, 31.0]
    assert command.damping.tolist() == [3.3, 3.2, 3.1]
    assert command.velocity.tolist() == command.effort.tolist() == [0.0, 0.0, 0.0]


def test_scalar_scale():
    command = action_command(resolve_action(contract(action_scale=2.0), JOINTS), np.array([1.0, 1.0], np.float32))
    assert command.position.tolist() == [2.03, 2.02, 0.0]


def test_actions_and_positions_are_clipped():
    limits = [[-0.1, 0.1], [-1.0, 1.0]]
    action_map = resolve_action(contract(action_clip=1.5, position_clip=limits), JOINTS)
    command = action_command(action_map, np.array([9.0, 9.0], np.float32))
    # elbow: 0.02 + 0.5 * 1.5, beyond its limit; shoulder: 0.03 + 0.25 * 1.5, within
    assert command.position.tolist() == [0.03 + 0.25 * 1.5, 0.1, 0.0]
    spread = resolve_action(contract(position_clip=[[-0.1, 0.1]]), JOINTS)
    assert action_command(spread, np.array([-9.0, 9.0], np.float32)).position.tolist() == [0.1, -0.1, 0.0]


def test_an_offset_of_its_own_replaces_the_default_pose():
    command = action_command(resolve_action(contract(action_offset=[0.5, 0.6]), JOINTS), np.zeros(2, np.float32))
    assert command.position.tolist() == [0.6, 0.5, 0.0]


def test_a_zero_action_is_the_default_pose_of_the_driven_joints():
    command = action_command(resolve_action(contract(), JOINTS), np.zeros(2, np.float32))
    assert command.position.tolist() == [0.03, 0.02, 0.0]


@given(st.lists(st.tuples(st.floats(width=32), st.floats(width=32)), min_size=1, max_size=5))
def test_a_batch_is_its_robots_bit_for_bit(actions):
    action_map = resolve_action(contract(), JOINTS)
    batch = np.array(actions, dtype=np.float32)
    with np.errstate(all="ignore"):
        together = action_command(action_map, batch)
        one_by_one = [action_command(action_map, row) for row in batch]
    for name in COMMAND_FIELDS:
        assert getattr(together, name).shape == (len(actions), 3)
        assert getattr(together, name).tobytes() == np.stack([getattr(c, name) for c in one_by_one]).tobytes()


def test_two_batch_dimensions():
    assert action_command(resolve_action(contract(), JOINTS), np.zeros((4, 5, 2), np.float32)).position.shape == (
        4,
        5,
        3,
    )


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (("shoulder", "elbow"), "the robot lacks wrist$"),
        (("neck", *JOINTS), "the policy lacks neck$"),
        (("Shoulder", "elbow", "wrist"), "the robot lacks shoulder; the policy lacks Shoulder$"),
    ],
)
def test_joints_that_do_not_match_are_named(joints, message):
    with pytest.raises(FieldError, match=f"^joint_names of the policy do not match the robot's joints: {message}"):
        resolve_action(contract(), joints)
