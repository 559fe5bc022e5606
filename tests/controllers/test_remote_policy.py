"""REMOTE without commands, and what an operator reads of it; `tests/survive` has which commands count."""

import numpy as np
import pytest
from rig import JOINTS, command, tick

from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.messages import RemoteCommand

NAN, INF = np.nan, np.inf
KD = np.array([1.0, 2.0, 3.0])


@pytest.mark.parametrize(("policy", "doing"), [("passive", "damped"), ("hold", "held")])
def test_an_operator_reads_once_when_commands_stop_and_when_they_come(policy, doing):
    controller = RemotePolicyController(JOINTS, KD, policy)
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
