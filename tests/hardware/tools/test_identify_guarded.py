"""`identify` of a motor that nothing stops when the program dies, with the motors in another process than the tool."""

import os
import subprocess
import sys
import time

import pytest

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak


@pytest.mark.parametrize("is_killed", [False, True])
def test_the_motor_is_disabled_whether_the_tool_ends_or_is_killed(is_killed):
    channel = f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"
    told = []
    with punctual_threads(behind=10):
        motors = MockServer(load_robot("lite_sito"), [channel], log=lambda _, text: told.append(text))
    words = ("identify", channel, "left_wrist_roll", "--robot", "lite_sito", "--yes", "--allow-no-timeout")
    with (
        motors,
        subprocess.Popen(
            [sys.executable, "-m", "humanoid_sim.hardware", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as tool,
    ):
        if is_killed:
            deadline = time.monotonic() + 20.0
            while "left_wrist_roll: enabled" not in told and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(1.0)
            tool.kill()
        said = "\n".join(tool.communicate(timeout=30.0))
        assert told[-1] == "left_wrist_roll: disabled"
        if is_killed:
            assert "guardian: the process of the loop has ended: damping left_wrist_roll for 3 s, then reset" in said
        else:
            assert tool.returncode == 0
            assert "guardian: " not in said.replace("warning: guardian: ", "")
