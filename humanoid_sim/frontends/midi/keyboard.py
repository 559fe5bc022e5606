"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as anybody knows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.frontends.midi.device import Source
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.song import PERCUSSION
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_REAL_TIME = 0xF8
"""The least status byte that stands for itself, and may come anywhere."""
_SYSTEM = 0xF0
"""The least status byte that belongs to no channel; what begins with it ends the running status."""
_ONE_DATA_BYTE = (0xC0, 0xD0)
"""Program change and channel pressure; all other messages of a channel have two."""


class Message(NamedTuple):
    """A message of a channel, or a real-time byte."""

    status: int
    """128 to 255."""
    data: tuple[int, ...] = ()
    """0 to 127 each."""

    @property
    def kind(self) -> int:
        """The status without the channel: 0x90 is note on."""
        return self.status if self.status >= _SYSTEM else self.status & 0xF0

    @property
    def channel(self) -> int:
        """0 to 15; of no meaning for a real-time byte."""
        return self.status & 0x0F


class MidiStream:
    """Messages of a byte stream, in whatever pieces it comes, as the MIDI 1.0 specification has them on the wire.

    mido's parser is for files: on a wire a message may come without its status byte, if it is that of the message
    before (running status), and with real-time bytes between its own. System exclusive and system common messages are
    passed over.
    """

    def __init__(self) -> None:
        """Begin where nothing is known: data bytes count from the first status byte on."""
        self._status = 0
        """Status byte of the message that data bytes belong to; 0: they belong to none that matters."""
        self._data: tuple[int, ...] = ()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Yield the messages that these bytes complete, in order."""
        for byte in data:
            if byte >= _REAL_TIME:
                yield Message(byte)
            elif byte >= 0x80:
                self._status = byte if byte < _SYSTEM else 0
                self._data = ()
            elif self._status:
                self._data += (byte,)
                if len(self._data) == (1 if self._status & 0xF0 in _ONE_DATA_BYTE else 2):
                    yield Message(self._status, self._data)
                    self._data = ()


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
        """Return the line if it was not given before."""
        if line in self._told:
            return ""
        self._told.add(line)
        return line


_ACTIVE_SENSING = 0xFE
_SILENCE = 0.3
"""s without a byte after which a keyboard that sends active sensing is gone, as the specification says."""
_PAUSE = 0.001
"""s after bytes came: a device that floods takes no more of the computer, and what it says grows too old."""
_RETRY = 0.5
"""s between two attempts to find a keyboard that is gone."""


class Keyboard:
    """`look` once a period, for as long as the period."""

    def __init__(
        self,
        source: Source,
        again: Callable[[], Source | None] = lambda: None,
        *,
        transpose: int = 0,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """Begin with no key down.

        Args:
            again: finds it when it comes back; None while it has not. May raise `InputError`.
            transpose: semitones that are added to every note.
            clock: s
        """
        self._source: Source | None = source
        self._again, self._clock = again, clock
        self._name = source.name
        self._stream = MidiStream()
        self._keys = PressedKeys(transpose)
        self.stamp = monotonic_ns()
        """CLOCK_MONOTONIC ns: all that had come until then is in `pressed`."""
        self._heard: float | None = None
        """Time of the latest byte, s, of a keyboard that sends active sensing; None until it does."""
        self._is_silent = False
        self._tried = 0.0

    @property
    def is_known(self) -> bool:
        """Return whether it is known which keys are down."""
        return self._source is not None and not self._is_silent

    @property
    def pressed(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first; none of a keyboard that is gone."""
        return self._keys.values

    def close(self) -> None:
        """Let go of it."""
        if self._source is not None:
            self._source.close()
            self._source = None

    def look(self, seconds: float) -> list[str]:
        """Take what comes within that time; lines for an operator.

        Raises `InputError` if the keyboard is there, and cannot be read.
        """
        if self._source is None:
            return self._find(seconds)
        lines: list[str] = []
        deadline = self._clock() + seconds
        rest = seconds
        while True:
            begun = monotonic_ns()
            data = self._source.read(rest)
            if data is None:
                self.stamp = begun
                self.close()
                return [*lines, self._lost("is gone")]
            lines += self._hear(data)
            if data:
                sleep(_PAUSE)
            else:
                self.stamp = begun
            if rest <= 0.0:
                break
            rest = max(deadline - self._clock(), 0.0)
        if self._heard is not None and self._clock() - self._heard > _SILENCE:
            self._is_silent = True
            lines.append(self._lost(f"sends active sensing, and nothing for {1e3 * _SILENCE:g} ms"))
        return lines

    def _find(self, seconds: float) -> list[str]:
        sleep(seconds)
        if self._clock() - self._tried < _RETRY:
            return []
        self._tried = self._clock()
        self._source = self._again()
        if self._source is None:
            return []
        self._name, self._stream = self._source.name, MidiStream()
        return [f"{self._name} is there again"]

    def _hear(self, data: bytes) -> list[str]:
        lines = []
        if data and self._is_silent:
            self._is_silent = False
            lines.append(f"{self._name} is heard again")
        for message in self._stream.feed(data):
            news = self._keys.hear(message)
            lines += [news] if news else []
            if message.status == _ACTIVE_SENSING:
                self._heard = self._clock()
        if data and self._heard is not None:
            self._heard = self._clock()
        return lines

    def _lost(self, why: str) -> str:
        """Release all keys: nobody will say when they are."""
        self._keys.release()
        self._heard = None
        return f"{self._name} {why}: all keys released"
