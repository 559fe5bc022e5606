"""DAMPING: captured positions, damping only; fails only where no joint is known. ZERO_TORQUE: cannot fail."""

import numpy as np
import pytest
from hypothesis import given
from rig import JOINTS, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.testing.properties import fingerprint
from humanoid_sim.testing.strategies import any_tick_inputs

NAN, INF = np.nan, np.inf
KD = np.array([1.5, 1.6, 1.7])


def run(controller, first, *later):
    memory = controller.activate(first)
    commands = []
    for given_tick in (first, *later):
        memory, command = controller.update(memory, given_tick)
        commands.append(command)
    return commands


@pytest.mark.parametrize("reading", [NAN, INF, -INF, 1e6 + 1.0, -1e7, 1e300])
def test_an_unknown_or_absurd_reading_makes_no_joint_limp(reading):
    (command,) = run(DampingController(JOINTS, KD), tick(position=(0.1, reading, 0.3)))
    assert command.position.tolist() == [0.1, 0.0, 0.3]
    assert command.damping.tolist() == KD.tolist()


@given(any_tick_inputs(3, 0.0), any_tick_inputs(3, np.nan))
def test_any_input(first, second):
    controller = DampingController(JOINTS, KD)
    memory = controller.activate(first)
    assert isinstance(memory, Fault) == (not np.isfinite(first.state.joint_position).any())
    if not isinstance(memory, Fault):
        _, command = controller.update(memory, first)
        _, later = controller.update(memory, second)
        assert command.is_finite()
        assert fingerprint(command) == fingerprint(later)


@given(any_tick_inputs(3, np.nan), any_tick_inputs(5, np.inf))
def test_zero_torque_cannot_fail(first, second):
    for zeros in run(ZeroTorqueController(JOINTS), first, second):
        assert zeros.position.shape == (3,)
        assert not any(getattr(zeros, name).any() for name in COMMAND_FIELDS)
