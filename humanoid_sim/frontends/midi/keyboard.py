"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as anybody knows."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep

from humanoid_sim.client import monotonic_ns
from humanoid_sim.frontends.midi.device import Source
from humanoid_sim.frontends.midi.keys import PressedKeys
from humanoid_sim.frontends.midi.stream import MidiStream
from humanoid_sim.mit import FloatArray

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
            source: the keyboard.
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
        """When the latest byte came, of a keyboard that sends active sensing."""
        self._is_silent = False
        self._tried = 0.0

    @property
    def is_known(self) -> bool:
        """Whether it is known which keys are down."""
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

        Raises:
            InputError: the keyboard is there, and cannot be read.
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
