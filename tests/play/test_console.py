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
    Intent,
    Mode,
    SessionHeader,
    StandbyState,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play.console import MODE_STYLES, ConsoleSink, Told

MESSAGES = ["joint_pos[3] is nan", "extern['keys']", "[/dim] [bold]", "ends with \\", "a\\[b]"]
AUTOMATIC = Told(expected_duration=10.0)
NAMES = {
    Mode.ZERO_TORQUE: "zero_torque_controller",
    Mode.DAMPING: "damping_controller",
    Mode.STANDBY: "standby_controller_a",
}


def record(index, mode, message="", **output):
    control = ControlMode(mode, NAMES[mode], message)
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
