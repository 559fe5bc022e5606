"""What a run prints: lines as things happen, and a line of status below them in a terminal."""

import contextlib
import io
import os
import pty
import termios
import time
from dataclasses import dataclass, replace

import numpy as np
import pyte
import pytest
from rich.console import Console

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.messages import (
    ControlMode,
    Event,
    FaultReport,
    Intent,
    Mode,
    SafetyLevel,
    SafetyStatus,
    SessionHeader,
    StandbyState,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, MITCommand, MITState
from humanoid_sim.play.console import MODE_STYLES, ConsoleSink, Told, status_parts

MESSAGES = ["joint_pos[3] is nan", "extern['keys']", "[/dim] [bold]", "ends with \\", "a\\[b]"]
AUTOMATIC = Told(expected_duration=10.0)
CONTROLLERS = {mode: name for name, mode in reversed(MODES.items())}


def record(index, mode, message="", **output):
    control = ControlMode(mode, CONTROLLERS[mode], message)
    tick = replace(TickOutput(MITCommand.zeros(2), control), **output)
    return TickRecord(index, TickInput(MITState.unknown(2, time=index * 0.5)), tick, 0.0, False, np.zeros(2))


def with_intents(tick, *intents):
    return replace(tick, input=replace(tick.input, intents=intents))


def printed(*records, events=(), terminal=False, told=AUTOMATIC):
    out = io.StringIO()
    sink = ConsoleSink(Console(file=out, width=200, force_terminal=terminal, highlight=False), told)
    sink.start(SessionHeader("fake", ("a", "b"), 0.5, 0))
    for item in records:
        sink.tick(item)
    for event in events:
        sink.event(Event(*event))
    sink.close()
    assert sink.error is None
    return out.getvalue()


def test_each_transition_is_a_line_with_time_and_reason():
    text = printed(
        record(0, Mode.ZERO_TORQUE, "started"),
        record(1, Mode.ZERO_TORQUE, "started"),
        record(2, Mode.DAMPING, "DAMP requested"),
        record(3, Mode.DAMPING, "DAMP requested"),
        events=((1.5, "ending: QUIT"),),
    )
    assert text.splitlines() == [
        "   0.000 s  ZERO_TORQUE  started",
        "   1.000 s  ZERO_TORQUE → DAMPING  DAMP requested",
        "   1.500 s  ending: QUIT",
    ]


def test_refusals_and_faults_without_a_transition_are_lines_too():
    fault = FaultReport("standby_controller_a", "damping_controller", "position of elbow is nan")
    text = printed(
        record(0, Mode.DAMPING, "started"),
        record(1, Mode.DAMPING, refusals=("LOAD_A refused: mode", "LOAD_B refused: mode")),
        record(2, Mode.DAMPING, faults=(fault,)),
    )
    assert text.splitlines()[1:] == [
        "   0.500 s  LOAD_A refused: mode",
        "   0.500 s  LOAD_B refused: mode",
        "   1.000 s  standby_controller_a failed: position of elbow is nan",
    ]


@pytest.mark.parametrize("message", MESSAGES)
def test_messages_are_printed_as_they_are(message):
    text = printed(record(0, Mode.DAMPING, message), record(1, Mode.DAMPING, refusals=(message,)))
    assert text.splitlines() == [f"   0.000 s  DAMPING  {message}", f"   0.500 s  {message}"]


def test_a_terminal_gets_colours_and_a_line_of_status():
    text = printed(record(0, Mode.DAMPING, "started"), record(4, Mode.DAMPING), terminal=True)
    assert "\x1b[33mDAMPING" in text  # yellow
    assert "DAMPING\x1b[0m  0 late ticks  20 %  2.0 s" in text
    assert text.endswith("\r\x1b[2K")  # and it is taken away in the end


def test_damp_is_answered_where_no_motor_is_driven():
    fault = FaultReport("damping_controller", "zero_torque_controller", "no joint position is known")
    text = printed(
        record(0, Mode.ZERO_TORQUE, "no motor is driven: reactivate failed"),
        with_intents(record(1, Mode.ZERO_TORQUE, faults=(fault,)), Intent.DAMP),
        told=Told(is_driven=lambda: False),
    )
    assert text.splitlines() == [
        "   0.000 s  ZERO_TORQUE  no motor is driven: reactivate failed",
        "   0.500 s  DAMP has no effect: no motor is driven; press e (or: mode reactivate)",
    ]


def test_an_intent_that_changes_nothing_is_answered():
    text = printed(
        record(0, Mode.DAMPING, "DAMP requested"),
        with_intents(record(1, Mode.DAMPING, "DAMP requested"), Intent.DAMP),
        record(2, Mode.DAMPING, "DAMP requested"),
    )
    assert text.splitlines()[1:] == ["   0.500 s  DAMP: already in DAMPING"]


@pytest.mark.parametrize(
    ("has_keys", "available", "expected"),
    [
        (True, MODES, "standby reached: l START_LOCOMOTION, r START_REMOTE"),
        (True, set(MODES) - {"remote_policy_controller"}, "standby reached: l START_LOCOMOTION"),
        (True, (), "standby reached"),
        (False, MODES, "standby reached"),
    ],
)
def test_standby_that_is_reached_is_announced_once(has_keys, available, expected):
    def standby(index, progress, *, reached):
        return record(index, Mode.STANDBY, "LOAD_A requested", standby=StandbyState(1, 2, progress, reached))

    text = printed(
        standby(0, 0.5, reached=False),
        standby(1, 1.0, reached=True),
        standby(2, 1.0, reached=True),
        told=Told(has_keys=has_keys, available=available),
    )
    assert text.splitlines() == ["   0.000 s  STANDBY  LOAD_A requested", f"   0.500 s  {expected}"]


def test_only_ticks_that_print_something_are_queued():
    sink = ConsoleSink(Console(file=io.StringIO()), AUTOMATIC)
    for index, mode in enumerate((Mode.ZERO_TORQUE, Mode.ZERO_TORQUE, Mode.DAMPING, Mode.DAMPING, Mode.DAMPING)):
        sink.tick(record(index, mode, refusals=("LOAD_A refused: mode",) if index == 4 else ()))
    sink.event(Event(2.5, "ending: QUIT"))
    assert sink.backlog == 4
    sink.close()


def test_every_mode_has_a_colour():
    assert set(MODE_STYLES) == set(Mode)


OPERATOR = Told(has_keys=True, available=MODES, walks=True, motion_frames=400)


def tick(mode, time=12.34, *, standby=None, safety=True):
    extern = {VELOCITY_COMMAND: Extern(np.array([0.3, 0.0, -0.1]), 0.0)}
    state = replace(MITState.unknown(2, time=time), extern=extern)
    output = TickOutput(MITCommand.zeros(2), ControlMode(mode, CONTROLLERS[mode], "why"), standby)
    statuses = () if safety else (SafetyStatus(SafetyLevel.FAULT, source="can0"),)
    return TickRecord(0, TickInput(state, statuses), output, 0.0, False, None)


def line(record, frame=None, told=OPERATOR, width=160):
    return "  ".join(status_parts(record, frame, 2, told, width))


def test_it_shows_what_is_and_what_is_possible_with_which_key():
    end = "v 0.30 0.00 -0.10  2 late ticks  12.3 s"
    damp = "space DAMP"
    assert line(tick(Mode.ZERO_TORQUE)) == f"ZERO_TORQUE  {damp}  q QUIT  e reactivate  ? help  {end}"
    keys = "a LOAD_A  b LOAD_B  q QUIT  e reactivate  ? help"
    assert line(tick(Mode.DAMPING)) == f"DAMPING  {damp}  {keys}  {end}"
    half = tick(Mode.STANDBY, standby=StandbyState(1, 2, 0.5, False))
    assert line(half) == f"STANDBY 75 %  {damp}  ? help  {end}"
    reached = tick(Mode.STANDBY, standby=StandbyState(1, 2, 1.0, True))
    assert line(reached) == f"STANDBY reached  {damp}  l START_LOCOMOTION  r START_REMOTE  ? help  {end}"
    assert line(tick(Mode.LOCOMOTION), 99) == f"LOCOMOTION 25 %  {damp}  arrows velocity  ? help  {end}"
    assert line(tick(Mode.LOCOMOTION), 500) == f"LOCOMOTION 100 %  {damp}  arrows velocity  ? help  {end}"
    assert line(tick(Mode.REMOTE)) == f"REMOTE  {damp}  ? help  {end}"


def test_what_a_fault_refuses_is_not_shown():
    assert line(tick(Mode.DAMPING, safety=False)).startswith("DAMPING  space DAMP  q QUIT  e reactivate  ? help  v ")


def test_damp_is_not_offered_where_no_motor_is_driven():
    told = replace(OPERATOR, is_driven=lambda: False)
    assert line(tick(Mode.ZERO_TORQUE, safety=False), told=told).startswith("ZERO_TORQUE  q QUIT  e reactivate  ? help")


def test_without_an_operator_at_the_keys_it_shows_how_far_the_run_is():
    told = Told(available=MODES, expected_duration=24.68)
    assert line(tick(Mode.LOCOMOTION), told=told) == "LOCOMOTION  2 late ticks  50 %  12.3 s"


@pytest.mark.parametrize("width", [79, 62, 40, 20, 12])
@pytest.mark.parametrize("mode", Mode)
def test_a_narrow_terminal_gets_the_most_important_first(mode, width):
    standby = StandbyState(1, 2, 1.0, True) if mode is Mode.STANDBY else None
    found = line(tick(mode, standby=standby), 99, width=width)
    assert len(found) <= max(width, len(f"{mode.name} reached"))
    assert found.startswith(mode.name)
    if width == 79:  # of a terminal of 80 columns
        assert "v 0.30 0.00 -0.10" in found
        assert "2 late ticks" in found
        assert "space" in found
    if mode is Mode.DAMPING and width == 62:
        assert found == "DAMPING  keys space a b q e ?  v 0.30 0.00 -0.10  2 late ticks"


@dataclass
class Screen:
    """A terminal of 24 lines of 80: what a run prints into `console` can be looked at."""

    console: Console
    master: int
    slave: int
    screen: pyte.Screen

    @property
    def lines(self):
        """What the screen shows, without empty lines at the end."""
        return "\n".join(row.rstrip() for row in self.screen.display).rstrip().split("\n")


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    for name in ("COLUMNS", "LINES"):
        monkeypatch.delenv(name, raising=False)
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, (24, 80))
    file = os.fdopen(slave, "w", encoding="utf-8")
    yield Screen(Console(file=file, highlight=False), master, slave, pyte.Screen(80, 24))
    os.close(master)  # first: whoever still waits to write is let go
    with contextlib.suppress(OSError):
        file.close()


def shown(terminal, *, seconds=0.4):
    """The screen after it has been read for a while."""
    stream = pyte.ByteStream(terminal.screen)
    os.set_blocking(terminal.master, False)
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            stream.feed(os.read(terminal.master, 65536))
        except BlockingIOError:
            time.sleep(0.01)
    return terminal.lines


def started(terminal, told=OPERATOR):
    sink = ConsoleSink(terminal.console, told)
    sink.start(SessionHeader("fake", ("a", "b"), 0.005, 0))
    return sink


@pytest.mark.soak
def test_it_stays_at_the_bottom_beside_a_long_list(terminal):
    for index in range(40):  # longer than the screen, as the check list of a real robot is
        terminal.console.print(f"ok      joint_{index}  at 0.000 rad")
    sink = started(terminal)
    sink.tick(tick(Mode.DAMPING))
    lines = shown(terminal)
    assert len(lines) == 24
    status = "DAMPING  keys space a b q e ?  v 0.30 0.00 -0.10  0 late ticks  12.3 s"
    assert lines[-3:] == ["ok      joint_39  at 0.000 rad", "  12.340 s  DAMPING  why", status]
    sink.event(Event(13.0, "reactivated"))
    assert shown(terminal)[-2:] == ["  13.000 s  reactivated", status]
    sink.tick(tick(Mode.DAMPING, 99.0))  # in place, not below
    assert shown(terminal)[-2:] == ["  13.000 s  reactivated", status.replace("12.3 s", "99.0 s")]
    sink.close()
    assert shown(terminal)[-1] == "  13.000 s  reactivated"


@pytest.mark.soak
def test_it_follows_the_size_of_the_terminal(terminal):
    termios.tcsetwinsize(terminal.slave, (24, 160))
    terminal.screen.resize(24, 160)
    sink = started(terminal)
    sink.tick(tick(Mode.DAMPING))
    assert "a LOAD_A  b LOAD_B  q QUIT  e reactivate  ? help" in shown(terminal)[-1]
    termios.tcsetwinsize(terminal.slave, (24, 40))
    sink.tick(tick(Mode.DAMPING, 14.0))
    assert shown(terminal)[-1] == "DAMPING  keys space a b q e ?"
    sink.close()


@pytest.mark.soak
def test_a_terminal_that_knows_no_control_sequences_has_it_too(terminal, monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    sink = started(terminal, Told())
    sink.tick(tick(Mode.DAMPING, 100.0))
    shown(terminal)
    sink.tick(tick(Mode.DAMPING, 2.0))
    assert shown(terminal)[-1] == "DAMPING  0 late ticks  2.0 s"
    sink.event(Event(3.0, "news"))
    assert shown(terminal)[-2:] == ["   3.000 s  news", "DAMPING  0 late ticks  2.0 s"]
    sink.close()


@pytest.mark.soak
def test_a_terminal_that_takes_nothing_never_makes_a_tick_wait(terminal):
    sink = started(terminal)
    longest = 0.0
    for index in range(4000):  # nobody reads the other end: it is full after the first few hundred lines
        if index % 2:
            sink.event(Event(0.0, "x" * 60))
        begin = time.perf_counter()
        sink.tick(tick(Mode.DAMPING, 0.01 * index))
        longest = max(longest, time.perf_counter() - begin)
        if index % 100 == 0:
            time.sleep(0.005)
    assert sink.backlog > 1000
    assert longest < 0.05
    sink.tick(tick(Mode.DAMPING, 77.0))
    deadline = time.monotonic() + 30.0
    while "77.0 s" not in shown(terminal, seconds=0.1)[-1]:  # somebody reads again: all that waits, then the present
        assert time.monotonic() < deadline
    assert sink.backlog == 0
    sink.close()
    assert sink.error is None
