"""ZERO_TORQUE: zeros whatever happens, and no way to fail."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from rig import JOINTS, command, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.zero_torque import ZeroTorqueController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import RemoteCommand
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.testing import any_tick_inputs

CONTROLLER = ZeroTorqueController(JOINTS)


def test_no_fallback():
    assert CONTROLLER.fallback is None
    assert CONTROLLER.joints == ("shoulder", "elbow", "wrist")


def test_zeros_in_all_five_fields():
    given_tick = tick(1.0, remote=RemoteCommand(command(), 1.0))
    _, zeros = CONTROLLER.update(CONTROLLER.activate(given_tick), given_tick)
    for name in COMMAND_FIELDS:
        assert getattr(zeros, name).tolist() == [0.0, 0.0, 0.0]


@given(any_tick_inputs(3, np.nan), any_tick_inputs(5, np.inf))
def test_cannot_fail(first, second):
    memory = CONTROLLER.activate(first)
    assert not isinstance(memory, Fault)
    for given_tick in (first, second):
        memory, zeros = CONTROLLER.update(memory, given_tick)
        assert zeros.position.shape == (3,)
        assert not any(getattr(zeros, name).any() for name in COMMAND_FIELDS)


@pytest.mark.parametrize("joints", [(), None, "elbow", ("a", "a"), ("a", ""), ("a", 1), 3])
def test_invalid_joints_are_named(joints):
    with pytest.raises(FieldError, match=r"^ZeroTorqueController\.joints: "):
        ZeroTorqueController(joints)
