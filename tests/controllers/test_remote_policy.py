"""REMOTE: what is applied, what is too old, and what never counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import JOINTS, KNOWN, command, tick

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import RemoteCommand
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing import fingerprint

NAN, INF = np.nan, np.inf
PASSIVE = "passive"


def remote_controller(**parameters):
    return RemotePolicyController(JOINTS, **parameters)


def run(controller, *steps, position=KNOWN):
    """What each `(time, remote)` leads to: a position (the rig's commands are uniform), PASSIVE or a fault's text."""
    first = steps[0]
    memory = controller.activate(tick(first[0], remote=first[1], position=position))
    assert not isinstance(memory, Fault)
    seen = []
    for time, remote in steps:
        result = controller.update(memory, tick(time, remote=remote, position=position))
        if isinstance(result, Fault):
            seen.append(result.message)
            continue
        memory, sent = result
        seen.append(PASSIVE if sent.damping.tolist() == controller.damping.tolist() else sent.position[0])
    return seen


def cmd(value, arrival):
    return RemoteCommand(command(value), arrival)


@pytest.mark.parametrize(
    ("parameters", "kd"),
    [
        ({}, [6.0, 6.0, 6.0]),
        ({"damping_scalar": 5.0}, [5.0, 5.0, 5.0]),
        ({"damping": [1.0, 2.0, 3.0]}, [1.0, 2.0, 3.0]),
        ({"damping": []}, [6.0, 6.0, 6.0]),
    ],
)
def test_passive_is_a_damped_hold_of_the_live_position(parameters, kd):
    controller = remote_controller(**parameters)
    memory = controller.activate(tick(10.0))
    for time, position in ((10.0, (0.1, 0.2, 0.3)), (10.02, (0.4, 0.5, 0.6))):
        memory, sent = controller.update(memory, tick(time, position=position))
        assert sent.position.tolist() == list(position)
        assert sent.damping.tolist() == kd
        assert sent.stiffness.tolist() == sent.velocity.tolist() == sent.effort.tolist() == [0.0, 0.0, 0.0]


def test_a_fresh_command_is_applied_as_it_is():
    controller = remote_controller()
    memory = controller.activate(tick(10.0))
    wanted = MITCommand([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0], [10.0, 11.0, 12.0], [13.0, 14.0, 15.0])
    _, sent = controller.update(memory, tick(10.02, remote=RemoteCommand(wanted, 10.01)))
    assert fingerprint(sent) == fingerprint(wanted)


@pytest.mark.parametrize(("policy", "late"), [("passive", PASSIVE), ("hold", 0.7)])
def test_staleness(policy, late):
    a = cmd(0.7, 10.01)
    steps = [(10.0, None), (10.02, a), (10.1, a), (10.109, a), (10.111, a), (10.2, a), (99.0, a)]
    seen = run(remote_controller(stale_command_policy=policy), *steps)
    assert seen == [PASSIVE, 0.7, 0.7, 0.7, late, late, late]


@pytest.mark.parametrize("timeout", [20, 500.0])
def test_the_timeout_is_a_parameter(timeout):
    a = cmd(0.7, 10.01)
    edge = 10.01 + timeout / 1000
    steps = [(10.0, None), (10.01, a), (edge - 1e-6, a), (edge + 1e-6, a)]
    assert run(remote_controller(stale_command_timeout_ms=timeout), *steps) == [PASSIVE, 0.7, 0.7, PASSIVE]


@pytest.mark.parametrize("policy", ["passive", "hold"])
@pytest.mark.parametrize("arrival", [-1e9, 0.0, 9.95, 9.9999999, 10.0, NAN, -INF, 10.001, 10.5, 1e9, INF])
def test_commands_from_before_activation_never_count(arrival, policy):
    """One that was there when the controller was activated is from before, whatever its stamp says."""
    controller, old = remote_controller(stale_command_policy=policy), cmd(0.7, arrival)
    assert run(controller, (10.0, old), (10.02, old), (10.04, old), (10.5, old), (10.52, old)) == [PASSIVE] * 5
    if not arrival > 10.0:
        assert run(controller, (10.0, None), (10.02, old), (10.04, old)) == [PASSIVE] * 3


def test_each_activation_starts_anew():
    controller = remote_controller(stale_command_policy="hold")
    a = cmd(0.7, 10.01)
    assert run(controller, (10.0, None), (10.02, a), (10.04, a))[-1] == 0.7
    assert run(controller, (10.06, a), (10.08, a)) == [PASSIVE, PASSIVE]


FIRST, SECOND, LATER, FUTURE = cmd(0.7, 10.01), cmd(0.8, 10.01), cmd(0.8, 1000.01), cmd(0.7, 1e6)
BROKEN = RemoteCommand(command(0.7, stiffness=[-1.0, 0.0, 0.0]), 9.0)
NARROW = RemoteCommand(command(0.7, n=2), 10.01)


@pytest.mark.parametrize(
    ("begin", "steps", "seen"),
    [
        # Two of the same instant: the second is applied, but it does not prolong the first.
        (None, [(10.02, FIRST), (10.1, SECOND), (10.12, SECOND)], [0.7, 0.8, PASSIVE]),
        # A future stamp buys no time.
        (None, [(time, FUTURE) for time in (10.02, 10.1, 10.13, 500.0, 1e6)], [0.7, 0.7, *[PASSIVE] * 3]),
        # The first command after activation counts whatever was there before.
        (cmd(0.7, 9.99), [(10.02, SECOND)], [0.8]),
        (cmd(0.7, NAN), [(10.02, SECOND)], [0.8]),
        # A clock that jumps back does not revive a stale command, nor keep a dead sender's command fresh.
        (None, [(time, FIRST) for time in (10.02, 10.3, 10.02, 10.04, 5.0)], [0.7, *[PASSIVE] * 4]),
        (None, [(time, FIRST) for time in (10.02, 5.0, 5.05, 5.11, 7.0, 10.0)], [*[0.7] * 3, *[PASSIVE] * 3]),
        # One that jumps forward makes commands stale, and new ones count.
        (None, [(10.02, FIRST), (1000.0, FIRST), (1000.02, LATER)], [0.7, PASSIVE, 0.8]),
        # A broken command from before activation does not matter; one of another width is a fault.
        (BROKEN, [(10.02, BROKEN)], [PASSIVE]),
        (None, [(10.02, NARROW)], ["remote command has shape (2,), expected (3,)"]),
    ],
)
def test_what_counts_and_how_long(begin, steps, seen):
    assert run(remote_controller(), (10.0, begin), *steps) == [PASSIVE, *seen]


@pytest.mark.parametrize("time", [NAN, INF, -INF])
def test_time_must_be_a_number(time):
    controller = remote_controller()
    memory = controller.activate(tick(0.0))
    for fault in (controller.activate(tick(time)), controller.update(memory, tick(time))):
        assert isinstance(fault, Fault)
        assert fault.message == f"time is {time}, expected a finite number"


@pytest.mark.parametrize(
    ("field", "values", "what", "least"),
    [
        ("stiffness", [1.0, -1.0, 1.0], "elbow is -1.0", "0"),
        ("damping", [1.0, 1.0, -1e-9], "wrist is -1e-09", "0"),
        ("damping", [NAN, 1.0, 1.0], "shoulder is nan", "0"),
        ("position", [NAN, 0.0, 0.0], "shoulder is nan", "-1e+06"),
        ("velocity", [0.0, INF, 0.0], "elbow is inf", "-1e+06"),
        ("effort", [0.0, 2e6, 0.0], "elbow is 2000000.0", "-1e+06"),
        ("effort", [0.0, 0.0, -INF], "wrist is -inf", "-1e+06"),
    ],
)
def test_a_broken_command_is_a_fault(field, values, what, least):
    bad = RemoteCommand(command(0.7, **{field: values}), 10.01)
    message = f"remote command's {field} of {what}, expected a finite number from {least} to 1e+06"
    assert run(remote_controller(), (10.0, None), (10.02, bad)) == [PASSIVE, message]


def test_unknown_joints_are_damped_at_zero():
    controller = remote_controller()
    memory = controller.activate(tick(10.0))
    _, sent = controller.update(memory, tick(10.0, position=(NAN, 0.2, INF)))
    assert sent.position.tolist() == [0.0, 0.2, 0.0]
    assert sent.damping.tolist() == [6.0, 6.0, 6.0]


def test_a_state_of_another_width_is_a_fault():
    controller = remote_controller()
    fault = controller.update(controller.activate(tick(10.0)), tick(10.02, position=(0.0,)))
    assert isinstance(fault, Fault)
    assert fault.message == "state has (1,) joint positions, expected (3,)"


@given(st.lists(st.tuples(st.floats(-0.2, 0.2), st.booleans(), st.floats(-0.3, 0.3)), max_size=40))
def test_a_live_sender_is_heard_and_a_dead_one_is_not(steps):
    """Against a model that counts the seconds that passed since each command was first seen."""
    controller = remote_controller()
    time, remote = 10.0, None
    memory = controller.activate(tick(time))
    age, in_force = INF, None
    for i, (jump, sends, skew) in enumerate(steps):
        time += jump
        if sends:
            remote = cmd(float(i), time + skew)
        age += max(jump, 0.0)
        if remote is not None and remote.arrival_time > 10.0 and remote is not in_force:
            in_force, age = remote, max(-skew, 0.0)
        memory, sent = controller.update(memory, tick(time, remote=remote))
        if abs(age - 0.1) > 1e-9:
            assert (sent.damping[0] == 4.0) == (age < 0.1)
            assert age > 0.1 or sent.position[0] == in_force.command.position[0]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"joints": ()}, "joints: is empty"),
        ({"stale_command_policy": "limp"}, "stale_command_policy: is 'limp', expected passive or hold"),
        ({"stale_command_policy": None}, "stale_command_policy: is None, expected passive or hold"),
        ({"stale_command_timeout_ms": 0}, "stale_command_timeout_ms: is 0, expected a finite number > 0"),
        ({"damping": [1.0]}, r"damping: has shape \(1,\), expected \(3,\)"),
        ({"damping_scalar": -6.0}, "damping_scalar: is -6.0, expected a finite number >= 0"),
    ],
)
def test_invalid_parameters_are_named(parameters, message):
    with pytest.raises(FieldError, match=rf"^RemotePolicyController\.{message}"):
        RemotePolicyController(**{"joints": JOINTS, **parameters})


@pytest.mark.parametrize(("policy", "doing"), [("passive", "the joints are damped"), ("hold", "the last one is held")])
def test_an_operator_is_told_once_when_commands_stop_and_when_they_come(policy, doing):
    controller = RemotePolicyController(JOINTS, stale_command_policy=policy)
    memory = controller.activate(tick(1.0))
    heard, latest = [], None
    for count in range(40):
        time = 1.0 + 0.01 * count
        latest = cmd(0.5, time) if count in (3, 4, 30) else latest
        memory, _ = controller.update(memory, tick(time, remote=latest))
        if memory.notice:
            heard.append((count, memory.notice))
    assert [count for count, _ in heard] == [3, 14, 30]  # the tenth tick after tick 4 is a rounding beyond 100 ms
    assert heard[0][1] == heard[2][1] == "remote commands arrive and are in force"
    assert heard[1][1] == f"no remote command for 100 ms: {doing}"
