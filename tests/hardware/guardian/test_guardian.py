"""A loop and its guardian in processes of their own, a listener on their bus, and signals that no program can catch."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from guarded_loop import COMMAND, DAMPING, DAMPING_TIME, GAINS, RESET, plan
from waiting import until

from humanoid_sim.hardware.bus.address import open_bus, parse_address
from humanoid_sim.hardware.guardian.guardian import Guardian
from humanoid_sim.messages import SafetyLevel

pytestmark = pytest.mark.soak

_LOOP = Path(__file__).parent / "guarded_loop.py"
_LATE = 0.15
"""s that this machine may be late."""


class Listener:
    """Everything on a channel, with the time at which it came."""

    def __init__(self, channel):
        self.frames = []
        self._closing = threading.Event()
        self._bus = open_bus(parse_address(channel))
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._closing.is_set():
            message = self._bus.recv(0.02)
            if message is not None:
                self.frames.append((time.monotonic(), message.arbitration_id, bytes(message.data)))

    def close(self):
        self._closing.set()
        self._thread.join()
        self._bus.shutdown()

    def times(self, identifier, after=0.0):
        return [at for at, found, _ in self.frames if found == identifier and at > after]

    def kinds(self, after):
        """Identifiers in order, each run of the same once."""
        kinds = []
        for at, found, _ in list(self.frames):
            if at > after and kinds[-1:] != [found]:
                kinds.append(found)
        return kinds


def _is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def channel():
    return f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"


@pytest.fixture
def listener(channel):
    listener = Listener(channel)
    yield listener
    listener.close()


class Loop:
    """The program, its guardian's process id, and what it says."""

    def __init__(self, process):
        self.process = process
        assert process.stdout is not None
        self.lines = process.stdout
        self.guardian = int(self.lines.readline().removeprefix("guardian "))


@contextmanager
def _looping(channel, *words):
    with subprocess.Popen(
        [sys.executable, str(_LOOP), channel, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        loop = Loop(process)
        try:
            yield loop
        finally:
            process.kill()
            process.send_signal(signal.SIGCONT)
            until(lambda: not _is_running(loop.guardian), 5.0)


def test_a_killed_loop_is_damped_for_and_then_reset(channel, listener):
    with _looping(channel) as loop:
        until(lambda: len(listener.times(COMMAND)) > 20)
        assert listener.kinds(0.0) == [COMMAND]  # a guardian that watches is silent
        loop.process.kill()
        killed = time.monotonic()
        until(lambda: not _is_running(loop.guardian))
        told = loop.process.stderr.read().splitlines()
    assert listener.kinds(killed)[-1] == RESET
    first = listener.times(GAINS)[0] - killed
    assert -0.01 < first < 0.1 + _LATE
    assert [found for _, found, _ in listener.frames if found != COMMAND][:3] == [GAINS, GAINS, DAMPING]
    damped = listener.times(DAMPING)
    assert len(damped) == 20  # 0.4 s every 20 ms
    assert DAMPING_TIME - 0.1 < damped[-1] - damped[0] < DAMPING_TIME + _LATE
    assert len(listener.times(RESET)) == 3
    assert listener.times(RESET)[0] > damped[-1]
    assert told == [
        "guardian: the process of the loop has ended: damping left_wrist_roll for 0.4 s, then reset",
        "guardian: damped and reset: left_wrist_roll",
    ]


def test_a_stopped_loop_is_displaced_and_commands_nothing_when_it_continues(channel, listener):
    with _looping(channel) as loop:
        until(lambda: len(listener.times(COMMAND)) > 20)
        loop.process.send_signal(signal.SIGSTOP)
        stopped = time.monotonic()
        until(lambda: listener.times(GAINS))
        assert 0.1 - 0.03 < listener.times(GAINS)[0] - stopped < 0.1 + _LATE
        time.sleep(0.1)
        loop.process.send_signal(signal.SIGCONT)
        continued = time.monotonic()
        assert loop.lines.readline() == "refused: the guardian has taken over [Error Code 108]; guardian FAULT\n"
        until(lambda: len(listener.times(RESET)) == 3)
        time.sleep(0.3)
        assert len(listener.times(RESET)) == 3  # the loop has seen that it was displaced
        assert listener.times(COMMAND, continued) == []
        assert listener.times(DAMPING, continued) != []


def test_a_displaced_loop_that_gives_way_may_send_once_the_guardian_has_ended(channel, listener):
    with _looping(channel, "release") as loop:
        until(lambda: len(listener.times(COMMAND)) > 20)
        loop.process.send_signal(signal.SIGSTOP)
        until(lambda: listener.times(GAINS))
        loop.process.send_signal(signal.SIGCONT)
        assert loop.lines.readline().startswith("refused: ")
        assert loop.lines.readline() == "drives: False\n"
        until(lambda: loop.process.poll() is not None)
    assert loop.process.returncode == 0
    assert len(listener.times(DAMPING)) == 20
    assert listener.frames[-1][1:] == (RESET, b"loop")


def test_a_terminals_signals_leave_the_guardian_alone(channel, listener):
    with _looping(channel) as loop:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
            os.kill(loop.guardian, number)
        until(lambda: len(listener.times(COMMAND)) > 20)
        assert _is_running(loop.guardian)
        assert listener.kinds(0.0) == [COMMAND]


@pytest.fixture
def guardian(channel):
    guardian = Guardian(plan(channel))
    yield guardian
    guardian.release(confirmed=True)


def _take_over(guardian, keep):
    for _ in range(400):
        keep()
        if guardian.has_taken_over:
            return
        time.sleep(0.01)
    pytest.fail("the guardian has not taken over", pytrace=False)


def test_decisions_without_frames_that_leave_are_no_sign_of_life(guardian):
    """As of a sending thread that hangs: the motors would go on with their last command."""
    guardian.standby()
    _take_over(guardian, guardian.beat)
    assert guardian.drives


def test_frames_without_decisions_are_no_sign_of_life(guardian):
    guardian.standby()
    guardian.beat()
    _take_over(guardian, lambda: guardian.count_sent(0))


def test_a_guardian_that_is_released_sends_nothing(channel, listener):
    guardian = Guardian(plan(channel))
    guardian.standby()
    guardian.beat()
    guardian.release(confirmed=True)
    guardian.release(confirmed=True)
    assert not _is_running(guardian.pid)
    assert listener.frames == []
    assert guardian.status() is None
    guardian.beat()  # a late one harms nobody


def test_motors_that_are_not_known_to_be_disabled_are_braked_at_the_end(channel, listener):
    guardian = Guardian(plan(channel))
    guardian.standby()
    guardian.release(confirmed=False)
    assert not _is_running(guardian.pid)
    assert listener.kinds(0.0)[:2] == [GAINS, DAMPING]
    assert listener.kinds(0.0)[-1] == RESET


def test_a_dead_guardian_is_a_warning_at_once(guardian):
    guardian.standby()
    assert guardian.status() is None
    os.kill(guardian.pid, signal.SIGKILL)
    os.waitid(os.P_PID, guardian.pid, os.WEXITED | os.WNOWAIT)
    status = guardian.status()
    assert (status.level, status.source) == (SafetyLevel.WARNING, "guardian")
    assert status.message == (
        "the guardian has died: were this program to die, nobody would stop left_wrist_roll; reactivate"
    )
