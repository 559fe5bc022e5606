"""What a run prints: lines as things happen, and a line of status below them in a terminal."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.messages import (
    ControlMode,
    Event,
    FaultReport,
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
from humanoid_sim.play.console import ConsoleSink

AUTOMATIC = {"expected_duration": 10.0}
CONTROLLERS = {mode: name for name, mode in reversed(MODES.items())}


def record(index, mode, message="", **output):
    control = ControlMode(mode, CONTROLLERS[mode], message)
    tick = replace(TickOutput(MITCommand.zeros(2), control), **output)
    return TickRecord(index, TickInput(MITState.unknown(2, time=index * 0.5)), tick, 0.0, False, np.zeros(2))


def printed(*records, events=(), terminal=False, told=AUTOMATIC):
    out = io.StringIO()
    sink = ConsoleSink(Console(file=out, width=200, force_terminal=terminal, highlight=False), **told)
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


OPERATOR = {"has_keys": True, "available": MODES, "walks": True, "motion_frames": 400}


def tick(mode, time=12.34, *, standby=None, safety=True):
    extern = {VELOCITY_COMMAND: Extern(np.array([0.3, 0.0, -0.1]), 0.0)}
    state = replace(MITState.unknown(2, time=time), extern=extern)
    output = TickOutput(MITCommand.zeros(2), ControlMode(mode, CONTROLLERS[mode], "why"), standby)
    statuses = () if safety else (SafetyStatus(SafetyLevel.FAULT, source="can0"),)
    return TickRecord(0, TickInput(state, statuses), output, 0.0, False, None)


def line(record, frame=None, told=OPERATOR, width=160):
    sink = ConsoleSink(Console(file=io.StringIO(), width=width + 1), **told)
    sink._frame, sink._overruns = frame, 2
    return "  ".join(sink._parts(record))


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
