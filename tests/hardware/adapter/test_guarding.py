"""A robot whose motors need a guardian: held by another process, which is killed or stopped."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from guarded_robot import DAMPING_TIME, hold, make_robot, without_timeout

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.guardian import guardian as guardian_module
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

_PROGRAM = Path(__file__).parent / "guarded_robot.py"


class Emulated:
    """The Lite's motors in this process, and what becomes of them."""

    def __init__(self, channel: str) -> None:
        self.lines: list[tuple[float, str]] = []
        with punctual_threads(behind=10):
            self.motors = VirtualMotors(load_robot("lite"), [channel], told=self._tell)

    def _tell(self, _: float, text: str) -> None:
        self.lines.append((time.monotonic(), text))

    def stopped(self, after: float) -> list[float]:
        return [at for at, text in self.lines if at > after and text.endswith(": stopped, in reset mode")]


@pytest.fixture
def channel() -> str:
    return f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"


@pytest.fixture
def emulated(channel: str) -> Iterator[Emulated]:
    emulated = Emulated(channel)
    with emulated.motors:
        yield emulated


@contextmanager
def _holding(channel: str, *words: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, str(_PROGRAM), channel, *words], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "holding\n"
            time.sleep(0.3)
            yield process
        finally:
            process.kill()
            process.send_signal(signal.SIGCONT)
            process.wait()
            process.stdout.read()  # until the guardian has ended too, if it has inherited it


def _until(condition: Callable[[], object], seconds: float = 10.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def test_the_arms_of_a_killed_program_sink_damped_and_only_then_fall(channel: str, emulated: Emulated) -> None:
    with _holding(channel) as process:
        process.kill()
        killed = time.monotonic()
        time.sleep(0.3)
        held = emulated.motors.truth
        assert emulated.stopped(killed) == []  # the guardian's commands feed their CAN timeout
        damping = np.array(load_robot("lite").damping_controller.damping or 1.0)
        slack = 0.1 + 0.1 * np.abs(held.joint_effort)
        assert (np.abs(held.joint_effort + damping * held.joint_velocity) < slack).all()  # and nothing but damping
        _until(lambda: len(emulated.stopped(killed)) == 14)
        stopped = [at - killed for at in emulated.stopped(killed)]
        assert DAMPING_TIME - 0.1 < min(stopped) <= max(stopped) < DAMPING_TIME + 0.4


@pytest.mark.slow
def test_a_stopped_program_is_displaced_and_may_begin_afresh(channel: str, emulated: Emulated) -> None:
    with _holding(channel, "reactivate") as process:
        process.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        _until(lambda: len(emulated.stopped(stopped)) == 14)
        process.send_signal(signal.SIGCONT)
        assert _line(process).startswith("FAULT the guardian has taken over, because this program was silent")
        assert _line(process) == "reactivated\n"
        assert _line(process) == "fine\n"
        time.sleep(0.2)
        process.kill()  # the new guardian does as the first one did
        killed = time.monotonic()
        _until(lambda: len(emulated.stopped(killed)) == 14)


@pytest.mark.slow
def test_a_displaced_program_closes_its_robot_after_the_guardian_has_finished(channel: str, emulated: Emulated) -> None:
    with _holding(channel, "close") as process:
        process.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        time.sleep(0.2)
        process.send_signal(signal.SIGCONT)
        assert _line(process).startswith("FAULT the guardian has taken over")
        assert _line(process) == "closed\n"
        assert time.monotonic() - stopped > DAMPING_TIME
        assert process.wait(5.0) == 0
        assert len(emulated.stopped(stopped)) >= 14  # these also have a timeout of their own


@pytest.mark.slow
def test_a_dead_guardian_is_a_warning_and_a_closed_robot_leaves_none(
    channel: str, emulated: Emulated, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_timeout(monkeypatch.setattr)
    monkeypatch.setattr(guardian_module, "_DEAF", 0.3)
    robot = make_robot(channel)
    try:
        robot.activate()
        (found,) = [check.text for check in robot.checks if check.subject == "guardian" and check.verdict.value == "ok"]
        pid = int(re.findall(r"process (\d+) damps left_shoulder_pitch, ", found)[0])
        (remains,) = [
            check.text for check in robot.checks if check.subject == "guardian" and check.verdict.value == "warning"
        ]
        assert "only the switch of their supply stops them" in remains
        hold(robot)
        os.kill(pid, signal.SIGKILL)
        for _ in range(25):
            hold(robot)
            time.sleep(0.02)
        _, statuses = robot.read()
        assert [(status.source, status.level) for status in statuses if status.level is not SafetyLevel.OK] == [
            ("guardian", SafetyLevel.WARNING)
        ]
        begin = time.monotonic()
    finally:
        robot.close()
    assert len(emulated.stopped(begin)) == 14


def test_a_guardian_that_does_not_start_keeps_the_robot_from_being_enabled(
    channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_timeout(monkeypatch.setattr)
    monkeypatch.setattr(guardian_module.sys, "executable", "/no/such/python")
    robot = make_robot(channel)
    with pytest.raises(RobotError, match=r"guardian: the guardian cannot be started: No such file or directory"):
        robot.activate()
    robot.close()


def test_motors_emulated_in_the_same_process_have_no_guardian(monkeypatch: pytest.MonkeyPatch) -> None:
    without_timeout(monkeypatch.setattr)
    with VirtualMotors(load_robot("lite"), ["virtual:unguarded"]):
        robot = make_robot("virtual:unguarded")
        robot.prepare()
        (told,) = [check.text for check in robot.checks if check.subject == "guardian"]
        assert told.endswith("emulated in this process, with which they end; no guardian watches them")
        robot.close()
