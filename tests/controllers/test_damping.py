"""DAMPING: captured positions, damping only; fails only where no joint was ever heard. ZERO_TORQUE: cannot fail."""

import numpy as np
import pytest
from hypothesis import given
from rig import JOINTS, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.testing import any_tick_inputs, fingerprint

NAN, INF = np.nan, np.inf
ZERO = ZeroTorqueController(JOINTS)


def run(controller, first, *later):
    memory = controller.activate(first)
    commands = []
    for given_tick in (first, *later):
        memory, command = controller.update(memory, given_tick)
        commands.append(command)
    return commands


@pytest.mark.parametrize(
    ("parameters", "kd"),
    [
        ({}, [1.0, 1.0, 1.0]),
        ({"damping_scalar": 5}, [5.0, 5.0, 5.0]),
        ({"damping": [], "damping_scalar": 2.5}, [2.5, 2.5, 2.5]),
        ({"damping": [1.0, 2.0, 0.0]}, [1.0, 2.0, 0.0]),
        ({"damping": (1, 2, 3), "damping_scalar": 9.0}, [1.0, 2.0, 3.0]),
        ({"damping": 4.0}, [4.0, 4.0, 4.0]),
        ({"damping_scalar": 0.0}, [0.0, 0.0, 0.0]),
    ],
)
def test_damping_per_joint_or_scalar(parameters, kd):
    (command,) = run(DampingController(JOINTS, **parameters), tick())
    assert command.damping.tolist() == kd


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"damping": [1.0, 2.0]}, r"damping: has shape \(2,\), expected \(3,\)"),
        ({"damping": [[1.0, 2.0, 3.0]]}, r"damping: has shape \(1, 3\)"),
        ({"damping": [1.0, -0.1, 1.0]}, r"damping: is -0.1 for elbow, expected a finite number >= 0"),
        ({"damping": [1.0, 1.0, NAN]}, "damping: is nan for wrist"),
        ({"damping": [INF, 1.0, 1.0]}, "damping: is inf for shoulder"),
        ({"damping": ["1", "2", "3"]}, "damping: dtype is <U1"),
        ({"damping": [[1.0], [1.0, 2.0]]}, "damping: not a rectangular array"),
        ({"damping": None}, "damping: dtype is object"),
        ({"damping_scalar": -1.0}, r"damping_scalar: is -1.0, expected a finite number >= 0"),
        ({"damping_scalar": NAN}, "damping_scalar: is nan"),
        ({"damping_scalar": INF}, "damping_scalar: is inf"),
        ({"damping_scalar": 10**400}, "damping_scalar: is 1000"),
        ({"damping_scalar": "1"}, "damping_scalar: is '1'"),
        ({"damping_scalar": True}, "damping_scalar: is True"),
        ({"damping_scalar": None}, "damping_scalar: is None"),
        ({"damping": [1.0, 1.0, 1.0], "damping_scalar": -1.0}, "damping_scalar: is -1.0"),
    ],
)
def test_invalid_parameters_are_named(parameters, message):
    with pytest.raises(FieldError, match=rf"^DampingController\.{message}"):
        DampingController(JOINTS, **parameters)


def test_position_is_captured_at_activation():
    commands = run(
        DampingController(JOINTS, damping=[1.5, 1.6, 1.7]),
        tick(0.0, position=(0.1, -0.2, 0.3)),
        tick(1.0, position=(9.0, 9.0, 9.0)),
        tick(-5.0, position=(NAN, NAN, NAN)),
    )
    assert len(commands) == 3
    for command in commands:
        assert command.position.tolist() == [0.1, -0.2, 0.3]
        assert command.velocity.tolist() == [0.0, 0.0, 0.0]
        assert command.effort.tolist() == [0.0, 0.0, 0.0]
        assert command.stiffness.tolist() == [0.0, 0.0, 0.0]
        assert command.damping.tolist() == [1.5, 1.6, 1.7]


@pytest.mark.parametrize("silent", [NAN, INF, -INF])
@pytest.mark.parametrize("known", range(3))
def test_one_known_joint_is_enough(known, silent):
    position = [silent] * 3
    position[known] = 0.25
    (command,) = run(DampingController(JOINTS), tick(position=position))
    assert command.position.tolist() == [0.25 if i == known else 0.0 for i in range(3)]
    assert command.damping.tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("absurd", [1e6 + 1.0, -1e7, 1e300])
def test_an_absurd_reading_makes_no_joint_limp(absurd):
    (command,) = run(DampingController(JOINTS), tick(position=(0.1, absurd, 0.3)))
    assert command.position.tolist() == [0.1, 0.0, 0.3]
    assert command.damping.tolist() == [1.0, 1.0, 1.0]
    (command,) = run(DampingController(JOINTS), tick(position=(absurd,) * 3))
    assert command.position.tolist() == [0.0, 0.0, 0.0]
    assert command.damping.tolist() == [1.0, 1.0, 1.0], "heard, if not believed: damping needs no position"
    (command,) = run(DampingController(JOINTS), tick(position=(1e6, -1e6, 0.3)))
    assert command.position.tolist() == [1e6, -1e6, 0.3], "the largest position that may be commanded"


@pytest.mark.parametrize(
    ("position", "message"),
    [
        ((NAN, INF, -INF), "no joint position is known"),
        ((0.0, 0.0), "state has (2,) joint positions, expected (3,)"),
    ],
)
def test_without_a_known_joint_or_of_another_width_it_is_a_fault(position, message):
    fault = DampingController(JOINTS).activate(tick(position=position))
    assert isinstance(fault, Fault)
    assert fault.message == message


@given(any_tick_inputs(3, 0.0), any_tick_inputs(3, np.nan))
def test_any_input(first, second):
    controller = DampingController(JOINTS)
    memory = controller.activate(first)
    assert isinstance(memory, Fault) == (not np.isfinite(first.state.joint_position).any())
    if not isinstance(memory, Fault):
        _, command = controller.update(memory, first)
        _, later = controller.update(memory, second)
        assert command.is_finite()
        assert fingerprint(command) == fingerprint(later)


@given(any_tick_inputs(3, np.nan), any_tick_inputs(5, np.inf))
def test_zero_torque_cannot_fail(first, second):
    memory = ZERO.activate(first)
    assert not isinstance(memory, Fault)
    for given_tick in (first, second):
        memory, zeros = ZERO.update(memory, given_tick)
        assert zeros.position.shape == (3,)
        assert not any(getattr(zeros, name).any() for name in COMMAND_FIELDS)
