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

from humanoid_sim.messages import Intent, Mode
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.losses import DeviceWatch, Interruption, running_time


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def ticks(interruption, clock, count=3):
    """Regular ticks of 20 ms, and what was asked for in them."""
    asked = []
    for _ in range(count):
        asked += interruption.poll(0.0, None)
        clock.now += 0.02
    return asked


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def interruption(clock):
    return Interruption(0.02, 0.1, clock)


def test_a_standstill_damps_once_and_says_how_long_it_was(interruption, clock):
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
    clock.now += 3.0
    interruption.restart()  # that was no part of the loop
    assert ticks(interruption, clock) == []


def test_after_a_stop_that_was_ended_one_missed_tick_is_a_standstill(interruption, clock):
    ticks(interruption, clock)
    interruption.note_continued()  # by a shell, to a process that ran
    assert ticks(interruption, clock) == []
    clock.now += 0.02
    interruption.note_continued()
    assert ticks(interruption, clock) == [Intent.DAMP]


def test_a_standstill_within_a_tick_is_noticed_before_its_command_is_sent(interruption, clock):
    ticks(interruption, clock)
    assert interruption.poll(0.0, None) == ()
    clock.now += 0.5
    assert interruption.beat()
    assert interruption.poll(0.0, None) == (Intent.DAMP,)
    assert not interruption.beat()


def test_a_refused_suspension_damps_and_says_why(interruption, clock):
    ticks(interruption, clock)
    interruption.refuse_suspension()
    assert ticks(interruption, clock) == [Intent.DAMP]
    expected = "SIGTSTP (Ctrl-Z): a process that holds motors is not suspended; DAMPING instead"
    assert (interruption.news(), interruption.news()) == (expected, "")


def test_the_clock_goes_on():
    before = running_time()
    time.sleep(0.01)
    assert 0.009 < running_time() - before < 5.0


CHILD = """
import time
from humanoid_sim.messages import Intent, Mode, TickInput, TickOutput
from humanoid_sim.session.keyboard import Keyboard
keyboard, heard, deadline = Keyboard(), [], time.monotonic() + 20.0
print("ready", flush=True)
while Intent.QUIT not in heard and time.monotonic() < deadline:
    heard += keyboard.poll(0.0, None)
    time.sleep(0.005)
keyboard.close()
print(*(intent.name for intent in heard))
"""


@pytest.mark.soak
def test_keys_typed_while_the_process_was_stopped_only_damp():
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


def test_ctrl_s_does_not_stop_the_output(monkeypatch):
    master, slave = pty.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        keyboard = Keyboard()
        assert not termios.tcgetattr(slave)[0] & termios.IXON
        keyboard.close()
        assert termios.tcgetattr(slave)[0] & termios.IXON
    os.close(master)


def test_what_was_decided_before_the_process_stood_still_is_not_sent_after(interruption, clock):
    """The process is stopped between a decision in STANDBY and the command."""
    stops = [8]

    def step(tick_input):
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


class Watched:
    def __init__(self):
        self.heard = {}
        self.told = []
        self.watch = DeviceWatch("gamepad", lambda: self.heard, self.told.append)
        self.run = rig.Run(rig.supervisor())
        self.output = None

    def tick(self, *intents):
        found = tuple(self.watch.poll(self.run.time, self.output))
        self.output = self.run.step(*intents, *found)
        return found

    def beat(self):
        self.heard["gamepad"] = self.run.time


@pytest.fixture
def watched():
    return Watched()


def test_a_device_that_was_never_there_asks_for_nothing_and_lets_nothing_drive_the_joints(watched):
    watched.heard["another"] = 0.0
    assert [watched.tick() for _ in range(50)] == [()] * 50
    watched.tick(Intent.DAMP)
    watched.tick(Intent.LOAD_A)
    assert watched.tick() == (Intent.DAMP,)
    assert watched.told == ["gamepad: lost, never heard: DAMP"]
    assert watched.tick() == ()


def test_its_loss_is_a_damp_in_every_mode_within_its_timeout():
    for controller, path in rig.PATHS.items():
        watched = Watched()
        watched.tick()
        for intent in path:
            watched.beat()
            watched.tick(intent)
            for _ in range(6):
                watched.beat()
                watched.tick()
        if controller != "rl_policy_controller":  # it faults without the velocity that it observes
            assert watched.output.control_mode.controller_name == controller
        last = watched.run.time
        watched.beat()
        while not watched.tick():
            assert watched.run.time - last < 1.0
        assert watched.run.time - last <= 0.2 + 2 * rig.PERIOD + 1e-9
        assert watched.output.control_mode.controller_name == "damping_controller"
        assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"]


def test_without_it_nothing_leaves_damping_and_with_it_again_the_operator_may(watched):
    watched.beat()
    watched.tick(Intent.DAMP)
    for _ in range(20):
        watched.tick()
    watched.tick(Intent.LOAD_A)
    assert watched.tick() == (Intent.DAMP,)
    assert watched.output.control_mode.controller_name == "damping_controller"
    assert watched.tick() == ()
    watched.beat()
    assert watched.tick(Intent.LOAD_A) == ()
    assert watched.output.control_mode.controller_name == "standby_controller_a"
    assert watched.told[-1] == "gamepad: there again"
    watched.heard["gamepad"] = float("nan")
    assert watched.tick() == (Intent.DAMP,), "a clock that is no number counts as a loss"


def test_heartbeats_that_waited_while_motors_were_enabled_are_no_loss(watched):
    watched.beat()
    watched.run.time += 7.0
    assert watched.tick() == ()
    watched.beat()
    watched.run.time += 7.0  # enabled afresh
    assert watched.tick() == ()
    silent = watched.run.time
    while not watched.tick():
        assert watched.run.time - silent < 0.3
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"]
    watched.run.time += 7.0
    watched.tick()
    assert watched.told == ["gamepad: lost, nothing heard for 0.2 s: DAMP"], "nor is one that is lost there again by it"
