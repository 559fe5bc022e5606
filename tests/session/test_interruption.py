import os
import pty
import signal
import subprocess
import sys
import termios
import time

import pytest
import rig
from fakes import FakeRobot, FakeSink, FakeSource, LoggingSupervisor, is_damping, session

from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.session.interruption import Interruption, running_time
from humanoid_sim.session.keyboard import Keyboard


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def ticks(interruption: Interruption, clock: Clock, count: int = 3) -> list[Intent]:
    """Regular ticks of 20 ms, and what was asked for in them."""
    asked: list[Intent] = []
    for _ in range(count):
        asked += interruption.poll(0.0, None)
        clock.now += 0.02
    return asked


def test_a_standstill_damps_once_and_says_how_long_it_was() -> None:
    clock = Clock()
    interruption = Interruption(0.02, 0.1, clock)
    clock.now += 50.0  # nothing stood still before the first tick
    assert ticks(interruption, clock) == []
    clock.now += 0.07
    assert ticks(interruption, clock) == []  # late ticks are overruns, and the motors still run
    clock.now += 1.28
    assert interruption.poll(0.0, None) == (Intent.DAMP,)
    assert interruption.news() == (
        "the process stood still for 1.30 s: DAMPING; motors whose CAN timeout is shorter have stopped, reactivate "
        "enables them again"
    )
    assert ticks(interruption, clock) == []
    assert interruption.news() == ""


def test_after_a_stop_that_was_ended_one_missed_tick_is_a_standstill() -> None:
    clock = Clock()
    interruption = Interruption(0.02, 0.1, clock)
    ticks(interruption, clock)
    interruption.note_continued()  # by a shell, to a process that ran
    assert ticks(interruption, clock) == []
    clock.now += 0.02
    interruption.note_continued()
    assert ticks(interruption, clock) == [Intent.DAMP]


def test_a_standstill_within_a_tick_is_noticed_before_its_command_is_sent() -> None:
    clock = Clock()
    interruption = Interruption(0.02, 0.1, clock)
    ticks(interruption, clock)
    assert interruption.poll(0.0, None) == ()
    clock.now += 0.5
    assert interruption.beat()
    assert interruption.poll(0.0, None) == (Intent.DAMP,)
    assert not interruption.beat()


def test_a_refused_suspension_damps_and_says_why() -> None:
    clock = Clock()
    interruption = Interruption(0.02, 0.1, clock)
    ticks(interruption, clock)
    interruption.refuse_suspension()
    assert ticks(interruption, clock) == [Intent.DAMP]
    expected = "SIGTSTP (Ctrl-Z): a process that holds motors is not suspended; DAMPING instead"
    assert interruption.news() == expected
    assert interruption.news() == ""


def test_what_was_no_part_of_the_loop_is_no_standstill() -> None:
    clock = Clock()
    interruption = Interruption(0.02, 0.1, clock)
    ticks(interruption, clock)
    clock.now += 3.0
    interruption.restart()
    assert ticks(interruption, clock) == []


def test_the_clock_goes_on() -> None:
    before = running_time()
    time.sleep(0.01)
    assert 0.009 < running_time() - before < 5.0


CHILD = """
import time
from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.session.keyboard import Keyboard
keyboard, heard, deadline = Keyboard(), [], time.monotonic() + 20.0
print("ready", flush=True)
while Intent.QUIT not in heard and time.monotonic() < deadline:
    heard += keyboard.poll(0.0, None)
    time.sleep(0.005)
keyboard.close()
print(*(intent.name for intent in heard))
"""


def test_keys_typed_while_the_process_was_stopped_only_damp() -> None:
    """What was meant for a shell moves nothing."""
    master, slave = pty.openpty()
    command = [sys.executable, "-c", CHILD]
    with subprocess.Popen(command, stdin=slave, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline() == "ready\n"
        os.write(master, b"b")
        time.sleep(0.3)
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        os.write(master, b"la a")
        child.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        os.write(master, b"rq")
        assert child.stdout.readline().split() == ["LOAD_B", "DAMP", "START_REMOTE", "QUIT"]
    os.close(master)
    os.close(slave)


def test_ctrl_s_does_not_stop_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = pty.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        keyboard = Keyboard()
        assert not termios.tcgetattr(slave)[0] & termios.IXON
        keyboard.close()
        assert termios.tcgetattr(slave)[0] & termios.IXON
    os.close(master)


def test_what_was_decided_before_the_process_stood_still_is_not_sent_after() -> None:
    """The process is stopped between a decision in STANDBY and the command."""
    clock, stops = Clock(), [8]
    interruption = Interruption(0.02, 0.1, clock)

    def step(tick_input: TickInput) -> None:
        clock.now += 0.02
        stops[0] -= 1
        if stops[0] == 0:
            clock.now += 5.0

    stack = LoggingSupervisor(rig.JOINTS, rig.supervisor().controllers, on_step=step)
    robot, sink = FakeRobot(), FakeSink()
    source = FakeSource({0: (Intent.DAMP,), 1: (Intent.LOAD_A,)}, finish_at=12)
    driven = session(robot, supervisor=stack, intents=[interruption, source], interruption=interruption, sinks=[sink])
    driven.run()
    modes = [record.output.control_mode.mode for record in sink.records]
    assert modes[:7] == [Mode.DAMPING, *[Mode.STANDBY] * 6]
    assert set(modes[7:]) == {Mode.DAMPING}
    assert all(is_damping(command) for command in robot.commands[7:-1])
    assert not is_damping(robot.commands[6])
    assert [text[:37] for text in sink.events[:1]] == ["the process stood still for 5.02 s: D"]
    assert [record.index for record in sink.records] == list(range(len(robot.commands)))
