"""Which of a piano's keys a MIDI keyboard holds down: note messages of all its channels together."""

from __future__ import annotations

import numpy as np

from humanoid_sim.frontends.midi.stream import Message
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.song import FIRST_NOTE, KEY_COUNT, PERCUSSION

_NOTE_OFF, _NOTE_ON, _CONTROL_CHANGE, _RESET = 0x80, 0x90, 0xB0, 0xFF
_ALL_OFF = (120, 123, 124, 125, 126, 127)
"""Controllers that silence a channel: all sound off, all notes off, and the changes of mode, which imply it."""


class PressedKeys:
    """A key is down as long as some channel holds it. The pedal holds strings, not keys: it changes nothing here."""

    def __init__(self, transpose: int = 0) -> None:
        """Begin with none; `transpose` in semitones is added to every note."""
        self._transpose = transpose
        self._held: set[tuple[int, int]] = set()
        """Channel and key."""
        self._told: set[str] = set()

    @property
    def values(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first."""
        values = np.zeros(KEY_COUNT)
        values[[key for _, key in self._held]] = 1.0
        return values

    @property
    def count(self) -> int:
        """Number of keys that are down."""
        return len({key for _, key in self._held})

    def release(self) -> None:
        """Release all."""
        self._held.clear()

    def hear(self, message: Message) -> str:
        """Take a message; what an operator should know of it, once, or ''."""
        if message.kind == _RESET:
            self._held.clear()
        elif message.kind == _CONTROL_CHANGE and message.data[0] in _ALL_OFF:
            self._held = {(channel, key) for channel, key in self._held if channel != message.channel}
        elif message.kind in (_NOTE_ON, _NOTE_OFF):
            return self._note(message)
        return ""

    def _note(self, message: Message) -> str:
        note, velocity = message.data
        key = note + self._transpose - FIRST_NOTE
        strikes = message.kind == _NOTE_ON and velocity > 0
        if message.channel == PERCUSSION:
            return self._once(f"channel {PERCUSSION + 1} is for drums: its notes count as no keys") if strikes else ""
        if not 0 <= key < KEY_COUNT:
            shifted = f", {note + self._transpose} with --transpose {self._transpose}," if self._transpose else ""
            limits = f"{FIRST_NOTE} to {FIRST_NOTE + KEY_COUNT - 1}"
            return self._once(f"note {note}{shifted} is beyond the piano's keys, {limits}") if strikes else ""
        if strikes:
            self._held.add((message.channel, key))
        else:
            self._held.discard((message.channel, key))
        return ""

    def _once(self, line: str) -> str:
        """The line if it was not given before."""
        if line in self._told:
            return ""
        self._told.add(line)
        return line
