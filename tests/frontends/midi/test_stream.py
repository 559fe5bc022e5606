"""MIDI at the level of its bytes; the examples are those of the MIDI 1.0 specification."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.frontends.midi.keyboard import MidiStream


def parsed(data, pieces=1000):
    """The messages of bytes given in hexadecimal, fed in pieces, in hexadecimal."""
    stream, raw = MidiStream(), bytes.fromhex(data)
    messages = [message for i in range(0, len(raw), pieces) for message in stream.feed(raw[i : i + pieces])]
    return [bytes((message.status, *message.data)).hex(" ") for message in messages]


@pytest.mark.parametrize("pieces", [1, 2, 3, 1000])
@pytest.mark.parametrize(
    ("data", "messages"),
    [
        ("90 3c 40 80 3c 40", ["90 3c 40", "80 3c 40"]),
        ("90 3c 40 3c 00 40 40", ["90 3c 40", "90 3c 00", "90 40 40"]),  # running status
        ("90 3c f8 40 fe 40 f8 40", ["f8", "90 3c 40", "fe", "f8", "90 40 40"]),  # real time within messages
        ("90 3c 40 f0 7e 09 3c 01 f7 3c 40 90 3c 00", ["90 3c 40", "90 3c 00"]),  # exclusive ends the running status
        ("f0 43 12 fe 00 f8 f7 91 3c 40", ["fe", "f8", "91 3c 40"]),  # real time within an exclusive message
        ("f0 43 12 90 3c 40", ["90 3c 40"]),  # one that was cut off
        ("90 3c 40 f2 10 20 3c 40", ["90 3c 40"]),  # common messages end it too
        ("90 3c 40 f6 3c 40", ["90 3c 40"]),
        ("90 3c 40 f4 3c 40", ["90 3c 40"]),  # not defined
        ("c3 07 08 3c", ["c3 07", "c3 08", "c3 3c"]),  # one data byte
        ("d0 7f b0 7b 00 e1 00 40", ["d0 7f", "b0 7b 00", "e1 00 40"]),
        ("3c 40 90 3c 40", ["90 3c 40"]),  # listened from the middle of a message on
        ("90 3c 91 3c 40", ["91 3c 40"]),  # cut off by the next
        ("ff f9 fd", ["ff", "f9", "fd"]),
    ],
)
def test_bytes_become_messages_however_they_are_cut(data, messages, pieces):
    assert parsed(data, pieces) == messages


@given(st.binary(max_size=60), st.integers(1, 60))
def test_any_bytes_make_whole_messages_in_any_pieces(data, pieces):
    whole = parsed(data.hex())
    assert parsed(data.hex(), pieces) == whole
    for text in whole:
        status, *rest = bytes.fromhex(text)
        assert len(rest) == (0 if status >= 0xF8 else 1 if status & 0xE0 == 0xC0 else 2)
        assert status >= 0x80 > max(rest, default=0)
