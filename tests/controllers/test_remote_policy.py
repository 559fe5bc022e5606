"""REMOTE without commands, and what an operator reads of it; `tests/survive` has which commands count."""

import numpy as np
import pytest
from rig import JOINTS, command, tick

from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import RemoteCommand

NAN, INF = np.nan, np.inf


@pytest.mark.parametrize(("parameters", "kd"), [({}, [6.0, 6.0, 6.0]), ({"damping": [1.0, 2.0, 3.0]}, [1.0, 2.0, 3.0])])
def test_passive_is_a_damped_hold_of_the_live_position(parameters, kd):
    controller = RemotePolicyController(JOINTS, **parameters)
    memory = controller.activate(tick(10.0))
    live = {(0.1, 0.2, 0.3): [0.1, 0.2, 0.3], (NAN, 0.5, INF): [0.0, 0.5, 0.0]}
    for position, held in live.items():
        memory, sent = controller.update(memory, tick(10.02, position=position))
        assert sent.position.tolist() == held
        assert sent.damping.tolist() == kd
        assert sent.stiffness.tolist() == sent.velocity.tolist() == sent.effort.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("parameters", "field"),
    [
        ({"stale_command_policy": "limp"}, "stale_command_policy: is 'limp', expected passive or hold"),
        ({"stale_command_timeout_ms": 0}, "stale_command_timeout_ms: is 0"),
        ({"damping_scalar": -6.0}, "damping_scalar: is -6.0"),
    ],
)
def test_invalid_parameters_are_named(parameters, field):
    with pytest.raises(FieldError, match=rf"^RemotePolicyController\.{field}"):
        RemotePolicyController(JOINTS, **parameters)


@pytest.mark.parametrize(("policy", "doing"), [("passive", "damped"), ("hold", "held")])
def test_an_operator_reads_once_when_commands_stop_and_when_they_come(policy, doing):
    controller = RemotePolicyController(JOINTS, stale_command_policy=policy)
    memory = controller.activate(tick(1.0))
    notices, latest = [], None
    for count in range(40):
        time = 1.0 + 0.01 * count
        latest = RemoteCommand(command(0.5), time) if count in (3, 4, 30) else latest
        memory, _ = controller.update(memory, tick(time, remote=latest))
        if memory.notice:
            notices.append((count, memory.notice))
    assert [count for count, _ in notices] == [3, 14, 30]  # the tenth tick after tick 4 is a rounding beyond 100 ms
    assert "100 ms" in notices[1][1]
    assert doing in notices[1][1]
