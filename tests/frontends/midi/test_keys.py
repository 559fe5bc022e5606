import pytest

from humanoid_sim.frontends.midi.keyboard import MidiStream, PressedKeys


def heard(data, transpose=0):
    """Keys that are down after these bytes, and what was told."""
    keys, stream = PressedKeys(transpose), MidiStream()
    told = [line for message in stream.feed(bytes.fromhex(data)) if (line := keys.hear(message))]
    assert keys.values.shape == (88,)
    return [int(key) for key in keys.values.nonzero()[0]], told


@pytest.mark.parametrize(
    ("data", "down"),
    [
        ("90 15 01 90 6c 7f", [0, 87]),  # A0 and C8
        ("90 3c 40 80 3c 40", []),
        ("90 3c 40 90 3c 00", []),  # velocity 0 is off
        ("90 3c 40 3c 00 40 40", [43]),  # with running status
        ("90 3c 40 90 3c 40 80 3c 00", []),  # struck twice, released once: there is one key
        ("80 3c 40", []),
        ("90 3c 40 91 3c 40 80 3c 00", [39]),  # another channel holds it
        ("90 3c 40 91 3c 40 80 3c 00 81 3c 00", []),
        ("90 3c 40 b0 40 7f 80 3c 00", []),  # the pedal holds the string, not the key
        ("90 3c 40 b0 40 00", [39]),
        ("90 3c 40 91 40 40 b0 7b 00", [43]),  # all notes off, of one channel
        ("90 3c 40 91 40 40 b0 78 00", [43]),  # all sound off
        ("90 3c 40 b0 7c 00", []),  # a change of mode is all notes off, too
        ("90 3c 40 b0 79 00", [39]),  # reset all controllers is not
        ("90 3c 40 b0 7a 00", [39]),
        ("90 3c 40 91 40 40 ff", []),  # system reset
        ("90 3c 40 fe f8", [39]),
        ("90 3c 40 a0 3c 7f d0 00 e0 00 00 c0 05", [39]),  # pressure, bend, program
    ],
)
def test_the_keys_that_are_down(data, down):
    assert heard(data) == (down, [])


def test_notes_beyond_the_piano_are_told_once():
    keys, told = heard("90 14 40 80 14 40 90 14 40 90 6d 40 90 15 40")
    assert keys == [0]
    assert told == ["note 20 is beyond the piano's keys, 21 to 108", "note 109 is beyond the piano's keys, 21 to 108"]


def test_notes_are_shifted():
    assert heard("90 30 40 90 3c 40", 12) == ([39, 51], [])
    assert heard("90 61 40 90 60 40 80 60 00", 12) == (
        [],
        ["note 97, 109 with --transpose 12, is beyond the piano's keys, 21 to 108"],
    )


def test_drums_are_no_keys():
    assert heard("99 3c 40 99 3e 40 90 40 40") == ([43], ["channel 10 is for drums: its notes count as no keys"])
