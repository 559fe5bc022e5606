"""Ticks and events of recordings made before their messages had all of today's fields.

What such a message lacks stands in its texts, in the words of the version that wrote it. They are looked at here and
nowhere else; the format in a recording's header says whether that is needed.
"""

from __future__ import annotations

from dataclasses import replace

from humanoid_sim.messages import Event, EventKind, TickRecord
from humanoid_sim.recording.codec import decode_event, decode_tick

__all__ = ["decode_earlier_event", "decode_earlier_tick"]

_FRESH_START = ("reactivated", "REACTIVATE failed")
_POLICY_FAILED = "policy failed: "


def decode_earlier_event(message: bytes) -> Event:
    """An event without a kind. Raises `CdrError`."""
    event = decode_event(message, has_kind=False)
    return replace(event, kind=EventKind.FRESH_START) if event.text.startswith(_FRESH_START) else event


def decode_earlier_tick(message: bytes) -> TickRecord:
    """A tick without a policy's error. Raises `CdrError`."""
    record = decode_tick(message, has_policy_error=False)
    for fault in record.output.faults:
        if fault.message.startswith(_POLICY_FAILED):
            error = fault.message.removeprefix(_POLICY_FAILED)
            return replace(record, output=replace(record.output, policy_error=error))
    return record
