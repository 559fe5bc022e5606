"""A robot with four Sito motors, held by another process that is killed or stopped; a listener on the wire."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from guarded_robot import DAMPING_TIME, STIFFNESS, brake_briefly, hold, make_robot
from waiting import until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import open_bus, parse_address
from humanoid_sim.hardware.bus.frame import frame_of
from humanoid_sim.hardware.checks import Verdict
from humanoid_sim.hardware.guardian import guardian as guardian_module
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.sito.codec import Gains, HostMessage, Reset, decode
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

_PROGRAM = Path(__file__).parent / "guarded_robot.py"
_ROBOT = load_robot("lite_sito")
_WRISTS = [i for i, joint in enumerate(_ROBOT.joints) if joint.motor is not None and joint.motor.family == "sito"]
_LATE = 0.15
"""s that this machine may be late."""


class Emulated:
    """The motors in this process: what becomes of them, and what they are told."""

    def __init__(self, channel):
        self.lines = []
        self.heard = []
        with punctual_threads(behind=10):
            self.motors = MockServer(_ROBOT, [channel], log=self._tell)
        self._bus = open_bus(parse_address(channel))
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _tell(self, _, text):
        self.lines.append((time.monotonic(), text))

    def _listen(self):
        while not self._closing.is_set():
            message = self._bus.recv(0.02)
            found = None if message is None else decode(frame_of(message), MOTORS["TA40-50"])
            if isinstance(found, HostMessage):
                self.heard.append((time.monotonic(), found))

    def close(self):
        self._closing.set()
        self._thread.join()
        self._bus.shutdown()
        self.motors.close()

    def stopped(self, after):
        """s after `after`, by joint, when it was disabled."""
        told = [(at, text) for at, text in list(self.lines) if at > after]
        ended = [(at, text) for at, text in told if text.endswith(": disabled")]
        return {text.partition(":")[0]: at - after for at, text in ended}

    def gains(self, after):
        return [(at - after, found) for at, found in list(self.heard) if at > after and isinstance(found, Gains)]

    def resets(self, after):
        return [at - after for at, found in list(self.heard) if at > after and isinstance(found, Reset)]


@pytest.fixture
def channel():
    return f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"


@pytest.fixture
def emulated(channel):
    emulated = Emulated(channel)
    yield emulated
    emulated.close()


@contextmanager
def _holding(channel):
    with subprocess.Popen(
        [sys.executable, str(_PROGRAM), channel], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert _line(process) == "holding\n"
            time.sleep(0.3)
            yield process
        finally:
            process.kill()
            process.wait()
            process.stderr.read()  # until the guardian has ended too, which has it as well


def _line(process):
    return process.stdout.readline()


def _names(joints):
    return {_ROBOT.joint_names[i] for i in joints}


def _is_only_damped(emulated):
    """Whether the wrists feel damping and nothing else."""
    truth = emulated.motors.truth
    damping = np.array(_ROBOT.damping_controller.damping or [_ROBOT.damping_controller.damping_scalar] * 14)
    expected = -damping * truth.joint_velocity
    return bool((np.abs(truth.joint_effort - expected)[_WRISTS] < 0.1 + 0.2 * np.abs(expected)[_WRISTS]).all())


def test_the_wrists_of_a_killed_program_are_damped_and_then_reset(channel, emulated):
    with _holding(channel) as process:
        assert any(gains.stiffness == pytest.approx(STIFFNESS) for _, gains in emulated.gains(0.0))
        process.kill()
        killed = time.monotonic()
        until(lambda: emulated.gains(killed + 0.02))
        assert {gains.stiffness for _, gains in emulated.gains(killed + 0.02)} == {0.0}
        assert emulated.gains(killed)[0][0] < _LATE
        time.sleep(0.25)
        assert _is_only_damped(emulated)
        until(lambda: set(emulated.stopped(killed)) == set(_ROBOT.joint_names))
    stopped = emulated.stopped(killed)
    arms = [at for name, at in stopped.items() if name not in _names(_WRISTS)]
    wrists = [at for name, at in stopped.items() if name in _names(_WRISTS)]
    assert max(arms) < 0.1 + _LATE  # by their own timeout
    assert DAMPING_TIME - 0.05 < min(wrists) <= max(wrists) < DAMPING_TIME + 0.1 + _LATE
    assert emulated.resets(killed)


@pytest.mark.usefixtures("emulated")
def test_a_dead_guardian_is_a_warning_and_a_closed_robot_leaves_none(channel, monkeypatch):
    brake_briefly(monkeypatch.setattr)
    robot = make_robot(channel)
    try:
        robot.activate()
        said = {check.verdict: check.text for check in robot.checks if check.subject == "guardian"}
        (pid,) = re.findall(r"process (\d+) damps left_wrist_roll, left_wrist_pitch, right_", said[Verdict.PASSED])
        assert "only the switch of their supply stops them" in said[Verdict.WARNING]
        hold(robot)
        os.kill(int(pid), signal.SIGKILL)
        for _ in range(40):
            hold(robot)
            time.sleep(0.02)
        _, statuses = robot.read()
        found = [status for status in statuses if "this program stood still" not in status.message]  # on a busy machine
        assert [(status.source, status.level) for status in found if status.level is not SafetyLevel.OK] == [
            ("guardian", SafetyLevel.WARNING)
        ]
    finally:
        robot.close()


def test_a_guardian_that_does_not_start_keeps_the_robot_from_being_enabled(channel, monkeypatch):
    monkeypatch.setattr(guardian_module.sys, "executable", "/no/such/python")
    robot = make_robot(channel)
    with pytest.raises(RobotError, match=r"guardian: the guardian cannot be started: No such file or directory"):
        robot.activate()
    robot.close()
