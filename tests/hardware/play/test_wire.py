"""What leaves on the wire when something happens to the process that holds the motors, or to its terminal."""

import fcntl
import itertools
import os
import pty
import re
import select
import signal
import statistics
import subprocess
import sys
import termios
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from wire import Listener

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.messages import Event, Mode, TickRecord
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

TICK = 0.02
"""s"""
SLACK = 0.03
"""s that a busy machine may add to a tick."""
CAN_TIMEOUT = 0.1
"""s without a frame after which a motor stops by itself, and its joint falls."""
MOTORS = 14
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""What steers a terminal."""


def own_terminal():
    """The child's standard input becomes the terminal that controls it, as a shell in a window has it."""
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    for number in (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP):
        signal.signal(number, signal.SIG_DFL)


@dataclass
class Operator:
    """Somebody at a terminal in which `play` drives motors; `listener` is beside the wire."""

    process: subprocess.Popen[bytes]
    master: int
    slave: int
    listener: Listener
    motors: VirtualMotors
    folder: Path
    seen: str = ""
    """Without what only steers a terminal."""
    _raw: str = ""
    before: list = field(default_factory=list)

    def wait_for(self, text, seconds=30.0):
        deadline = time.monotonic() + seconds
        while text not in self.seen:
            assert time.monotonic() < deadline, f"{text!r} never came; the end: {self.seen[-1000:]}"
            self._read(0.05)
        self.seen = self.seen.partition(text)[2]

    def _read(self, timeout):
        if select.select([self.master], [], [], timeout)[0]:
            self._raw += os.read(self.master, 4096).decode(errors="replace")
            whole, escape, rest = self._raw.rpartition("\x1b")  # what a read cut in two waits for its other half
            done = self._raw if CONTROL.match(escape + rest) or not escape else whole
            self._raw = self._raw[len(done) :]
            self.seen += CONTROL.sub("", done)

    def type(self, key):
        """Press a key; when."""
        os.write(self.master, key.encode())
        return time.monotonic()

    def stands(self):
        """Walk to the standby pose, whose arms the motors hold up."""
        self.wait_for("started")
        self.type("d")
        self.wait_for("DAMP requested")
        self.type("a")
        self.wait_for("LOAD_A requested")
        time.sleep(0.8)

    def end(self, seconds=20.0):
        """Read what is still printed until the process has ended; its status."""
        deadline = time.monotonic() + seconds
        while self.process.poll() is None:
            assert time.monotonic() < deadline, self.seen[-1000:]
            self._read(0.05)
        return self.process.returncode

    @property
    def attributes(self):
        return termios.tcgetattr(self.slave)

    def told(self, what, moment):
        print(f"\n{what}\n{self.listener.table(moment)}")

    def recorded(self):
        """The modes and events of the recording, and whether it is complete; it must replay."""
        recording = open_recording(self.folder / "r.mcap")
        entries = list(recording.entries())
        modes = [entry.output.control_mode.mode for entry in entries if isinstance(entry, TickRecord)]
        events = [entry.text for entry in entries if isinstance(entry, Event)]
        assert run_program(replay.main, [str(self.folder / "r.mcap")]) == 0
        return modes, events, recording.is_complete


@pytest.fixture
def stretched(make_robot):
    """Stands with its arms stretched out to the sides."""

    def stretch(document):
        for pose in ("a", "b"):
            document[f"standby_controller_{pose}"]["pose_segments"] = [[0.0] * 14, [0.0] * 14]
            document[f"standby_controller_{pose}"]["segment_durations"] = [0.4, 0.2]

    return make_robot(change=stretch)


@pytest.fixture
def operator(stretched, folder):
    with standing(stretched, folder) as found:
        yield found


@contextmanager
def standing(robot, folder, environment=None):
    channel = f"udp_multicast:239.76.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"
    with punctual_threads(behind=10):
        motors = VirtualMotors(load_robot(robot), [channel])
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, b"\x18\x00\x50\x00\x00\x00\x00\x00")  # 24 lines of 80
    options = ("--hardware", channel, "--robot", robot, "--policy", "placeholder", "--manual", "--yes")
    before = termios.tcgetattr(slave)
    with motors, Listener(channel, robot) as listener:
        with subprocess.Popen(
            [sys.executable, "-m", "humanoid_sim.play", *options, "--calibration", "none", "--record", "r.mcap"],
            cwd=folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**os.environ, "TERM": "xterm", **(environment or {})},
            preexec_fn=own_terminal,  # noqa: PLW1509 - nothing of the parent's threads is touched
        ) as process:
            operator = Operator(process, master, slave, listener, motors, folder, before=before)
            try:
                operator.stands()
                yield operator
            finally:
                process.kill()
        os.close(operator.slave)
        os.close(operator.master)


def ends_through_damping(operator, moment, *, within=TICK + SLACK):
    """No motor is driven any more after a tick; all are damped every tick until they rest, and then stopped."""
    listener = operator.listener
    listener.settle()
    driven, damped = listener.after(moment, "drive"), listener.after(moment, "damp")
    assert all(frame.time - moment <= within for frame in driven)
    assert damped[0].time - moment <= within + 0.005
    assert len({frame.motor_id for frame in damped[:MOTORS]}) == MOTORS
    assert len(damped) >= 20 * MOTORS  # 0.5 s of rest at the least
    for motor_id in {frame.motor_id for frame in damped}:
        own = [frame.time for frame in damped if frame.motor_id == motor_id]
        assert statistics.median(b - a for a, b in itertools.pairwise(own)) < TICK + SLACK
    stops = listener.after(damped[-1].time, "stop")
    assert {frame.motor_id for frame in stops} == {frame.motor_id for frame in damped}
    assert longest_gap(operator, moment) < CAN_TIMEOUT


def longest_gap(operator, moment):
    """s at most that a motor was without a frame, from the last before the moment until it was told to stop."""
    heard = operator.listener.frames
    gaps = []
    for motor_id in {frame.motor_id for frame in heard}:
        own = [frame for frame in heard if frame.motor_id == motor_id]
        begin = max(i for i, frame in enumerate(own) if frame.time < moment)
        end = next(i for i, frame in enumerate(own) if i > begin and frame.kind == "stop")
        assert {frame.kind for frame in own[begin + 1 : end]} <= {"drive", "damp", "other"}, "and never limp before"
        gaps += [late.time - early.time for early, late in itertools.pairwise(own[begin : end + 1])]
    return max(gaps)


def _signal(number):
    """What sends it; the exit status of a run that it ends."""

    def send(operator):
        operator.process.send_signal(number)
        return 128 + number

    return send


def _quit(operator):
    """While the arms still fall."""
    operator.type("d")
    operator.wait_for("STANDBY → DAMPING")
    operator.type("q")
    return 0


def _fault(operator):
    """A motor reports a fault; the session damps, and goes on until somebody ends it."""
    operator.motors.inject(Fault("over_temperature", ("left_elbow_pitch",), start=operator.motors.time))
    operator.wait_for("STANDBY → DAMPING")
    time.sleep(0.5)
    operator.type("q")
    return 1  # safety was not OK


@pytest.mark.parametrize(
    "end",
    [_signal(signal.SIGINT), _signal(signal.SIGTERM), _quit, _fault],
    ids=["SIGINT", "SIGTERM", "QUIT", "a motor's fault"],
)
def test_no_motor_waits_for_its_timeout_while_it_is_damped_until_it_is_told_to_stop(operator, end, request):
    """SIGQUIT and SIGHUP: below, with the terminal."""
    moment = time.monotonic()
    expected = end(operator)
    assert operator.end() == expected, operator.seen
    operator.told(request.node.name, moment)
    last = operator.listener.after(moment - TICK, "drive")[-1].time
    ends_through_damping(operator, moment if expected >= 128 else last)
    gap = longest_gap(operator, moment)
    print(f"at most {1e3 * gap:.0f} ms between two frames to a motor")
    assert gap < CAN_TIMEOUT


def test_ctrl_backslash_ends_the_run_through_damping(operator):
    moment = operator.type("\x1c")
    assert operator.end() == 128 + signal.SIGQUIT
    operator.told("Ctrl-\\", moment)
    ends_through_damping(operator, moment)
    assert operator.attributes == operator.before
    modes, events, is_complete = operator.recorded()
    assert modes[-1] is Mode.DAMPING
    assert "ending: SIGQUIT" in events
    assert is_complete


def test_ctrl_z_damps_and_the_session_goes_on(operator):
    moment = operator.type("\x1a")
    operator.wait_for("a process that holds motors is not")
    time.sleep(1.0)
    listener = operator.listener
    operator.told("Ctrl-Z", moment)
    assert all(frame.time - moment <= TICK + SLACK for frame in listener.after(moment, "drive"))
    assert listener.after(moment, "stop") == []
    assert len(listener.after(moment + 0.1, "damp")) >= 20 * MOTORS  # of 45 ticks
    operator.type("a")  # and it can be driven again
    operator.wait_for("DAMPING → STANDBY")
    operator.type("d")
    operator.wait_for("STANDBY → DAMPING")
    operator.type("q")
    assert operator.end() == 0
    assert operator.attributes == operator.before
    assert operator.recorded()[2]


def test_a_forced_stop_that_ends_begins_in_damping(operator):
    operator.process.send_signal(signal.SIGSTOP)
    stopped = time.monotonic()
    time.sleep(1.0)
    operator.type("la")  # as to a shell that has taken the terminal
    moment = time.monotonic()
    operator.process.send_signal(signal.SIGCONT)
    operator.wait_for("the process stood still for 1.")
    operator.wait_for("find out why this program stood still for 1.")  # and not: check its cable
    time.sleep(0.5)
    listener = operator.listener
    operator.told("SIGSTOP", stopped)
    operator.told("SIGCONT", moment)
    assert [frame for frame in listener.after(stopped + 0.01) if frame.time < moment] == []
    assert listener.after(moment, "drive") == []
    assert listener.after(moment, "damp")[0].time - moment <= TICK + SLACK
    operator.type("e")
    operator.wait_for("reactivated: the robot is verified and enabled afresh")
    operator.type("q")
    assert operator.end() == 1  # the motors stopped by their CAN timeout
    assert operator.attributes == operator.before
    modes, events, is_complete = operator.recorded()
    assert is_complete
    assert Mode.DAMPING in modes[modes.index(Mode.STANDBY) :]
    assert any("stood still" in event for event in events)


def test_a_killed_process_sends_nothing_more_and_its_terminal_is_the_shells_to_restore(operator):
    operator.process.kill()
    moment = time.monotonic()
    assert operator.end() == -signal.SIGKILL
    time.sleep(0.5)
    operator.told("SIGKILL", moment)
    assert operator.listener.after(moment + 0.01) == []
    modes, _, is_complete = operator.recorded()
    assert modes[-1] is Mode.STANDBY
    assert not is_complete


def test_a_closed_terminal_ends_the_run_through_damping(operator):
    os.close(operator.slave)
    os.close(operator.master)
    moment = time.monotonic()
    assert operator.process.wait(20.0) == 128 + signal.SIGHUP
    operator.master, operator.slave = pty.openpty()  # for the fixture to close
    operator.told("closed terminal", moment)
    ends_through_damping(operator, moment)
    modes, events, is_complete = operator.recorded()
    assert modes[-1] is Mode.DAMPING
    assert "ending: SIGHUP" in events
    assert is_complete


def test_a_lost_display_changes_nothing(stretched, folder):
    display, number = os.pipe()
    with subprocess.Popen(
        ["Xvfb", "-displayfd", str(number), "-screen", "0", "320x240x24"], pass_fds=[number], stderr=subprocess.DEVNULL
    ) as server:
        os.close(number)
        with os.fdopen(display) as told:
            name = f":{told.readline().strip()}"
        with standing(stretched, folder, {"DISPLAY": name}) as operator:
            server.kill()
            server.wait()
            moment = time.monotonic()
            time.sleep(1.0)
            operator.told("lost display", moment)
            driven = operator.listener.after(moment, "drive")
            assert len(driven) >= 45 * MOTORS
            assert operator.listener.after(moment, "damp", "zero", "stop") == []
            operator.type("d")
            operator.wait_for("STANDBY → DAMPING")
            operator.type("q")
            assert operator.end() == 0
            assert operator.recorded()[2]
