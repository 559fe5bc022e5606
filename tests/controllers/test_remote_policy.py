"""REMOTE: what is applied, what is too old, and what never counts."""

import numpy as np
import pytest
from rig import JOINTS, command, tick

from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import RemoteCommand

NAN, INF = np.nan, np.inf


def remote_controller(**parameters):
    return RemotePolicyController(JOINTS, **parameters)


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


FIRST, SECOND, LATER, FUTURE = cmd(0.7, 10.01), cmd(0.8, 10.01), cmd(0.8, 1000.01), cmd(0.7, 1e6)


def test_unknown_joints_are_damped_at_zero():
    controller = remote_controller()
    memory = controller.activate(tick(10.0))
    _, sent = controller.update(memory, tick(10.0, position=(NAN, 0.2, INF)))
    assert sent.position.tolist() == [0.0, 0.2, 0.0]
    assert sent.damping.tolist() == [6.0, 6.0, 6.0]


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
