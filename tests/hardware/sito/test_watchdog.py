"""A loop and its watchdog in processes of their own, a listener on their bus, and signals that no program catches."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from waiting import until
from watched_loop import COMMAND, DAMPING, DAMPING_TIME, GAINS, RESET, motor

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.can_bus import open_bus, parse_address
from humanoid_sim.hardware.sito import watchdog
from humanoid_sim.hardware.sito.watchdog import BEAT, ENABLED, RELEASED, Watchdog
from humanoid_sim.messages import SafetyLevel

_LOOP = Path(__file__).parent / "watched_loop.py"
_LATE = 0.15
"""s that this machine may be late."""


@pytest.mark.parametrize(
    ("sent", "closes", "reason"),
    [
        (b"", True, ""),
        (ENABLED, True, "the loop has ended"),
        (BEAT, True, "the loop has ended"),
        (BEAT + ENABLED + RELEASED, False, ""),
        (ENABLED + BEAT, False, "no command has left"),
    ],
)
def test_the_child_acts_on_silence_and_death_of_an_armed_loop_only(sent, closes, reason):
    loop, child = socket.socketpair()
    with loop, child:
        loop.send(sent)
        if closes:
            loop.close()
        found = watchdog._watch(child)
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


@pytest.fixture
def channel():
    return f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"


@pytest.fixture
def listener(channel):
    with open_bus(parse_address(channel)) as bus:
        yield bus


def until_sent(listener, identifier, count):
    """Receive until so many frames with an identifier have come; identifiers and times, s, of all that came."""
    found = []
    while [number for number, _ in found].count(identifier) < count:
        message = listener.recv(60.0)
        assert message is not None, "it never came"
        found.append((message.arbitration_id, message.timestamp))
    return found


def what_came(listener):
    """Everything that was sent and not received yet, as `until_sent`."""
    return [(message.arbitration_id, message.timestamp) for message in iter(lambda: listener.recv(0.0), None)]


def _is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextmanager
def _looping(channel):
    """Run the loop's program; gives its process, and its watchdog's id."""
    with subprocess.Popen(
        [sys.executable, str(_LOOP), channel], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        dog = int(process.stdout.readline())
        try:
            yield process, dog
        finally:
            process.kill()
            process.send_signal(signal.SIGCONT)
            until(lambda: not _is_running(dog))


def test_a_killed_loops_motors_are_damped_and_then_reset(channel, listener):
    with _looping(channel) as (loop, dog):
        until_sent(listener, COMMAND, 20)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
            os.kill(dog, number)  # a terminal's signals leave it alone
        before = until_sent(listener, COMMAND, 5)
        assert {found for found, _ in before} == {COMMAND}, "a watchdog that watches is silent"
        loop.kill()
        until(lambda: not _is_running(dog))
        printed = loop.stderr.read()
    others = [found for found, _ in what_came(listener) if found != COMMAND]
    assert others == [GAINS, GAINS, DAMPING] * 20 + [RESET] * 5  # 0.4 s every 20 ms
    assert printed == "watchdog: the loop has ended: damping left_wrist_roll for 0.4 s, then reset\n"


@pytest.mark.soak
def test_a_stopped_loop_is_displaced_in_time_and_commands_nothing_when_it_continues(channel, listener):
    with _looping(channel) as (loop, dog):
        until_sent(listener, COMMAND, 20)
        loop.send_signal(signal.SIGSTOP)
        stopped = time.time()
        frames = until_sent(listener, RESET, 7)  # they go on until it has seen that it was displaced
        began = next(at for number, at in frames if number == GAINS)
        assert 0.1 - 0.03 < began - stopped < 0.1 + _LATE
        damped = [at for number, at in frames if number == DAMPING]
        assert DAMPING_TIME - 0.1 < damped[-1] - damped[0] < DAMPING_TIME + _LATE
        loop.send_signal(signal.SIGCONT)
        assert loop.stdout.readline() == "displaced: watchdog FAULT\n"
        until(lambda: not _is_running(dog))
        time.sleep(0.1)
        assert COMMAND not in dict(what_came(listener))


@pytest.fixture
def dog(channel, monkeypatch):
    monkeypatch.setattr(watchdog, "DAMPING_TIME", 0.1)
    dog = Watchdog([motor(channel)])
    yield dog
    dog.release(confirmed=True)


@pytest.mark.soak
@pytest.mark.parametrize("confirmed", [True, False])
def test_motors_are_braked_at_the_end_unless_they_are_known_to_be_disabled(dog, listener, confirmed):
    dog.enabled()
    dog.beat()
    dog.release(confirmed=confirmed)
    assert not _is_running(dog.pid)
    sent = {number for number, _ in what_came(listener)}
    assert sent == (set() if confirmed else {GAINS, DAMPING, RESET})


def test_its_own_death_is_a_warning(dog):
    dog.enabled()
    assert dog.status() is None
    os.kill(dog.pid, signal.SIGKILL)
    until(dog.status)
    status = dog.status()
    assert (status.level, status.source) == (SafetyLevel.WARNING, "watchdog")
    assert "left_wrist_roll" in status.message


def test_a_watchdog_that_does_not_start_is_said():
    with pytest.raises(RobotError, match="does not start: can9: cannot be opened"):
        Watchdog([motor("can9")])
