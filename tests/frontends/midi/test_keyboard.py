"""Bytes of a keyboard become keys that are down; active sensing and unplugging, by a clock of the test's own."""

from collections import deque

import pytest

from humanoid_sim.frontends.midi.device import Source
from humanoid_sim.frontends.midi.keyboard import Keyboard, MidiStream, PressedKeys


class Scripted(Source):
    """A keyboard in a time of its own: bytes by the second in which they come; None for being unplugged."""

    def __init__(self, *script, name="Keystation"):
        self.name, self.now, self.is_open = name, 0.0, True
        self._script = deque(script)

    def read(self, seconds):
        assert self.is_open
        end = self.now + seconds
        if self._script and self._script[0][0] <= end:
            time, data = self._script.popleft()
            self.now = max(time, self.now)
            return data
        self.now = end
        return b""

    def close(self):
        self.is_open = False


def down(keyboard):
    return [int(key) for key in keyboard.pressed.nonzero()[0]]


PRESS, OTHER, SENSING = bytes((0x90, 60, 64)), bytes((0x90, 64, 64)), b"\xfe"


def test_a_keyboard_that_sends_it_and_falls_silent_is_lost():
    source = Scripted((0.0, PRESS + SENSING), (0.205, b"\xf8"), (1.005, OTHER + SENSING), (1.205, SENSING))
    keyboard = Keyboard(source, clock=lambda: source.now)
    found = {}
    while source.now < 1.7:
        for line in keyboard.look(0.01):
            found[round(source.now, 2)] = (line, down(keyboard), keyboard.is_known)
    lost = "Keystation sends active sensing, and nothing for 300 ms: all keys released"
    assert found == {0.51: (lost, [], False), 1.01: ("Keystation is heard again", [43], True), 1.51: (lost, [], False)}


def test_one_that_is_unplugged_releases_its_keys_and_may_come_back():
    first, second = Scripted((0.0, PRESS), (0.02, None)), Scripted((9.0, OTHER), name="Keystation 2")
    second.now = 9.0
    answers = deque([None, second])
    now = [0.0]
    keyboard = Keyboard(first, answers.popleft, clock=lambda: max(first.now, now[0]))
    assert keyboard.look(0.01) == []
    assert down(keyboard) == [39]
    assert keyboard.look(0.02) == ["Keystation is gone: all keys released"]
    assert (down(keyboard), keyboard.is_known, first.is_open) == ([], False, False)
    now[0] = 1.0
    assert keyboard.look(0.001) == []
    assert len(answers) == 1, "looked for once"
    now[0] = 1.3
    assert keyboard.look(0.001) == []
    assert len(answers) == 1, "half a second between two attempts"
    now[0] = 1.6
    assert keyboard.look(0.001) == ["Keystation 2 is there again"]
    now[0] = 9.0
    keyboard.look(0.0)
    assert (down(keyboard), keyboard.is_known) == ([43], True)
    keyboard.close()
    assert not second.is_open


def test_a_flood_is_never_the_present():
    """What waits behind it may have released every key."""

    class Flood(Scripted):
        def read(self, seconds):
            self.now += 0.0001
            return PRESS * 80

    source = Flood()
    keyboard = Keyboard(source, clock=lambda: source.now)
    begun = keyboard.stamp
    for _ in range(5):
        keyboard.look(0.002)
    assert down(keyboard) == [39]
    assert keyboard.stamp == begun


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
