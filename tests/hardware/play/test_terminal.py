"""An operator at a terminal: asked before the motors are enabled, then at the keys."""

import os
import pty
import select
import subprocess
import sys
import time

import pytest

from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak


class Terminal:
    """The far end of a pseudo terminal."""

    def __init__(self):
        self.master, self.slave = pty.openpty()
        self.seen = ""

    def wait_for(self, text, seconds=30.0):
        """Read until a text comes after what was waited for before."""
        deadline = time.monotonic() + seconds
        while text not in self.seen:
            assert time.monotonic() < deadline, self.seen
            if select.select([self.master], [], [], 0.1)[0]:
                self.seen += os.read(self.master, 4096).decode(errors="replace")
        self.seen = self.seen.partition(text)[2]

    def type(self, text):
        os.write(self.master, text.encode())

    def close(self):
        os.close(self.master)
        os.close(self.slave)


@pytest.mark.parametrize("answer", ["y", "n"])
def test_an_operator_is_asked_and_drives(answer, quick, folder, calibrate):
    calibrate()
    channel = f"udp_multicast:239.75.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"
    told = []
    with punctual_threads(behind=10):
        motors = VirtualMotors(load_robot(quick), [channel], told=lambda _, text: told.append(text))
    terminal = Terminal()
    options = ("--hardware", channel, "--robot", quick, "--policy", "placeholder", "--manual", "--viewer", "none")
    with (
        motors,
        subprocess.Popen(
            [sys.executable, "-m", "humanoid_sim.play", *options, "--record", "none"],
            cwd=folder,
            stdin=terminal.slave,
            stdout=terminal.slave,
            stderr=terminal.slave,
            env={**os.environ, "TERM": "dumb"},
        ) as process,
    ):
        terminal.wait_for("Checks, before anything is enabled")
        terminal.wait_for("without torque? [y/N]")
        assert not [text for text in told if text.endswith(": enabled")]
        terminal.type(f"{answer}\n")
        if answer == "y":
            terminal.wait_for("ZERO_TORQUE  started")
            terminal.type("d")
            terminal.wait_for("DAMPING  DAMP requested")
            terminal.type("x")
            terminal.wait_for("the key 'x' means nothing; h or ? shows those that do")
            terminal.type("e")
            terminal.wait_for("reactivated: the robot is verified and enabled afresh")
            terminal.type("q")
            terminal.wait_for("missed deadlines")
        else:
            terminal.wait_for("nothing was enabled")
        assert process.wait(30.0) == 0
    terminal.close()
    enabled = [text for text in told if text.endswith(": enabled")]
    assert len(enabled) >= 28 if answer == "y" else enabled == []
