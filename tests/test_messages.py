"""Modes, intents, safety bits and events are those of the wire and of recordings, number for number."""

import pytest

from humanoid_sim import messages


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (messages.Mode, "ZERO_TORQUE DAMPING STANDBY LOCOMOTION REMOTE"),
        (messages.SafetyLevel, "OK WARNING FAULT CRITICAL"),
        (messages.EventKind, "NOTE FRESH_START SUPPORT FAILURE LOSS ENDING FALL PUSH"),
    ],
)
def test_numbers(kind, names):
    assert [(one.name, one.value) for one in kind] == [(name, i) for i, name in enumerate(names.split())]


def test_bits_and_words():
    names = ["BUS_OFF", "RX_TIMEOUT", "TX_QUEUE_OVERRUN", "MOTOR_FAULT", "TEMPERATURE_LIMIT", "INVALID_FRAME"]
    assert {flag.name: flag.value for flag in messages.SafetyFlag} == {name: 1 << i for i, name in enumerate(names)}
    assert all(intent.value == intent.name.lower() for intent in messages.Intent)
    assert len(messages.Intent) == 6
