"""What a run prints: lines as things happen, and a line of status below them in a terminal."""

import io
from dataclasses import replace

import numpy as np
from records import record_of
from rich.console import Console

from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.messages import Event, FaultReport, Mode, SessionHeader, StandbyState
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, MITState
from humanoid_sim.play.console import ConsoleSink


def record(index, mode, message="", **output):
    velocity = Extern(np.array([0.3, 0.0, -0.1]), 0.0)
    state = replace(MITState.unknown(2, time=index * 0.5), extern={VELOCITY_COMMAND: velocity})
    return record_of(state, mode, message, index=index, **output)


def printed(*records, events=(), terminal=False, width=200, **options):
    out = io.StringIO()
    sink = ConsoleSink(Console(file=out, width=width, force_terminal=terminal, highlight=False), **options)
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


def line(*arguments, width=200, **output):
    text = printed(record(*arguments, **output), terminal=True, width=width, has_keys=True, available=MODES)
    return text.split("\x1b[2K")[-2].rstrip("\r")


def test_the_line_shows_what_is_and_what_is_possible_with_which_key_as_far_as_there_is_room():
    now = "v 0.30 0.00 -0.10  1.0 s"
    keys = "space DAMP  a LOAD_A  b LOAD_B  q QUIT  e reactivate  ? help"
    assert line(2, Mode.DAMPING) == f"DAMPING  {now}  {keys}"
    assert line(2, Mode.DAMPING, width=30) == f"DAMPING  {now}"[:29]
    half, reached = StandbyState(1, 2, 0.5, False), StandbyState(1, 2, 1.0, True)
    assert line(2, Mode.STANDBY, standby=half) == f"STANDBY  75 %  {now}  space DAMP  ? help"
    assert "STANDBY  reached" in line(2, Mode.STANDBY, standby=reached)
    assert "l START_LOCOMOTION  r START_REMOTE" in line(2, Mode.STANDBY, standby=reached)
