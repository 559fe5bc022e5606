"""What messages of earlier versions lack is found in their texts."""

from dataclasses import replace

import pytest
from recording_samples import bits, make_tick

from humanoid_sim.messages import Event, EventKind, FaultReport
from humanoid_sim.recording.codec import TickEncoder, encode_event
from humanoid_sim.recording.earlier import (
    decode_earlier_event,
    decode_earlier_tick,
)
from humanoid_sim.ros2.cdr import CdrError


def earlier_tick(*faults):
    """The message without its last field: the count of a sequence that is empty."""
    return TickEncoder(3).encode(make_tick(41, faults=tuple(FaultReport("a", "b", text) for text in faults)))[:-4]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("reactivated: the robot is verified and enabled afresh; warning: wrist: old", EventKind.FRESH_START),
        ("REACTIVATE failed: lite: 1 problem: can0: a", EventKind.FRESH_START),
        ("REACTIVATE refused: requires ZERO_TORQUE or DAMPING, mode is STANDBY", EventKind.NOTE),
        ("support released", EventKind.NOTE),
    ],
)
def test_an_event_is_known_by_its_first_words(text, kind):
    assert decode_earlier_event(encode_event(Event(0.5, text))[:-1]) == Event(0.5, text, kind)


def test_what_the_policy_raised_follows_the_word_failed():
    record = decode_earlier_tick(earlier_tick("observation is nan", "policy failed: out of memory"))
    assert record.output.policy_error == "out of memory"
    assert decode_earlier_tick(earlier_tick("observation is nan")).output.policy_error is None
    assert bits(replace(record.output, policy_error=None).faults) == bits(record.output.faults)


def test_a_message_of_today_is_none_of_an_earlier_version():
    with pytest.raises(CdrError):
        decode_earlier_tick(TickEncoder(3).encode(make_tick(41)))
