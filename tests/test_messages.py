"""Modes, intents and safety bits are those of the wire, number for number."""

from dataclasses import fields

import pytest

from humanoid_sim import messages
from humanoid_sim.errors import FieldError


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (messages.Mode, {"ZERO_TORQUE": 0, "DAMPING": 1, "STANDBY": 2, "LOCOMOTION": 3, "REMOTE": 4}),
        (messages.SafetyLevel, {"OK": 0, "WARNING": 1, "FAULT": 2, "CRITICAL": 3}),
        (
            messages.SafetyFlag,
            {
                **{"BUS_OFF": 1, "RX_TIMEOUT": 2, "TX_QUEUE_OVERRUN": 4, "MOTOR_FAULT": 8},
                **{"TEMPERATURE_LIMIT": 16, "INVALID_FRAME": 32},
            },
        ),
        (
            messages.EventKind,
            {
                **{"NOTE": 0, "FRESH_START": 1, "SUPPORT": 2, "FAILURE": 3, "LOSS": 4, "ENDING": 5, "FALL": 6},
                **{"POLICY": 7, "PUSH": 8},
            },
        ),
        (
            messages.Intent,
            {name.upper(): name for name in ("damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit")},
        ),
    ],
)
def test_names_and_numbers(kind, values):
    assert {one.name: one.value for one in kind} == values
    assert messages.SafetyFlag.NONE.value == 0


@pytest.mark.parametrize(
    ("message", "names"),
    [
        (messages.SafetyStatus, ["level", "flags", "source", "message"]),
        (messages.ControlMode, ["mode", "controller_name", "status_message"]),
        (messages.StandbyState, ["current_segment", "total_segments", "progress", "is_finished"]),
        (messages.RemoteCommand, ["command", "arrival_time"]),
        (messages.PolicyStep, ["frame", "observation", "action"]),
        (messages.FaultReport, ["controller", "fallback", "message", "is_bug"]),
        (messages.Event, ["time", "text", "kind"]),
        (messages.TickInput, ["state", "safety", "intents", "remote"]),
        (
            messages.TickOutput,
            ["command", "control_mode", "standby", "quit", "faults", "refusals", "policy_step", "policy_error"],
        ),
    ],
)
def test_field_order(message, names):
    assert [f.name for f in fields(message)] == names


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        *(
            ((level,), "level: is .*, expected one of OK 0, WARNING 1, FAULT 2, CRI")
            for level in (-1, 4, None, "F", 0.5)
        ),
        *(((2, flags), "flags: is .*, expected an unsigned 32-bit") for flags in (-1, 2**32, None, "BUS_OFF", 1.0)),
    ],
)
def test_what_cannot_be_on_the_wire_is_refused(values, problem):
    with pytest.raises(FieldError, match=rf"^SafetyStatus\.{problem}"):
        messages.SafetyStatus(*values)
    assert messages.SafetyStatus(2, 0x80000001).flags.value == 0x80000001, "a flag without a name survives"
