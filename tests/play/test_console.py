from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from humanoid_sim.messages import (
    ControlMode,
    Event,
    FaultReport,
    Mode,
    SessionHeader,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play.console import MODE_STYLES, ConsoleSink

MESSAGES = ["joint_pos[3] is nan", "extern['keys']", "[/dim] [bold]", "ends with \\", "a\\[b]"]
NAMES = {Mode.ZERO_TORQUE: "zero_torque_controller", Mode.DAMPING: "damping_controller"}


def record(index: int, mode: Mode, message: str = "", **output: object) -> TickRecord:
    control = ControlMode(mode, NAMES[mode], message)
    tick = replace(TickOutput(MITCommand.zeros(2), control), **output)
    return TickRecord(index, TickInput(MITState.unknown(2, time=index * 0.5)), tick, 0.0, False, np.zeros(2))


def printed(*records: TickRecord, events: tuple[tuple[float, str], ...] = (), terminal: bool = False) -> str:
    out = io.StringIO()
    sink = ConsoleSink(Console(file=out, width=200, force_terminal=terminal, highlight=False), 10.0)
    sink.start(SessionHeader("fake", ("a", "b"), 0.5, 0))
    for item in records:
        sink.tick(item)
    for event in events:
        sink.event(Event(*event))
    sink.close()
    assert sink.error is None
    return out.getvalue()


def test_each_transition_is_a_line_with_time_and_reason() -> None:
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


def test_refusals_and_faults_without_a_transition_are_lines_too() -> None:
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
def test_messages_are_printed_as_they_are(message: str) -> None:
    text = printed(record(0, Mode.DAMPING, message), record(1, Mode.DAMPING, refusals=(message,)))
    assert text.splitlines() == [f"   0.000 s  DAMPING  {message}", f"   0.500 s  {message}"]


def test_a_terminal_gets_colours_and_a_bar() -> None:
    text = printed(record(0, Mode.DAMPING, "started"), record(4, Mode.DAMPING), terminal=True)
    assert "\x1b[33mDAMPING" in text  # yellow
    assert "20%" in text
    assert "2.00 s" in text


def test_only_ticks_that_print_something_are_queued() -> None:
    sink = ConsoleSink(Console(file=io.StringIO()), 10.0)
    for index, mode in enumerate((Mode.ZERO_TORQUE, Mode.ZERO_TORQUE, Mode.DAMPING, Mode.DAMPING, Mode.DAMPING)):
        sink.tick(record(index, mode, refusals=("LOAD_A refused: mode",) if index == 4 else ()))
    sink.event(Event(2.5, "ending: QUIT"))
    assert sink.backlog == 4
    sink.close()


def test_every_mode_has_a_colour() -> None:
    assert set(MODE_STYLES) == set(Mode)
