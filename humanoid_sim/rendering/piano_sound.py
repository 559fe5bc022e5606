"""Sound of a piano's keys: additive synthesis, note by note, of the keys that are down."""

from __future__ import annotations

import wave
from collections.abc import Iterable
from functools import lru_cache
from typing import IO, NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

RATE = 44_100
"""Samples per second."""

_CONCERT_A, _A4 = 440.0, 48
"""Hz, and the key that sounds so."""
_LONGEST = 6.0
"""s of a note whose key stays down."""
_ATTACK, _END = 0.004, 0.05
"""s in which a tone comes up, and fades out where it is cut off."""
_RELEASE = 0.06
"""s in which a damped string falls to 1/e."""
_SILENT = 9.0 * _RELEASE
"""s after its release at which nobody hears a note any more (-78 dB)."""
_BRIGHTEST = 12_000.0
"""Hz, of the highest partial."""
_STRUCK_AT = 1.0 / 8.0
"""Part of its length at which the hammer strikes a string: partials with a node there are missing."""
_LEVEL = 0.35
"""Peak of a single note, of full scale."""
_KNEE, _CEILING = 0.7, 0.97
"""From where on the sum of many notes is bent, and what it never reaches."""

Samples = npt.NDArray[np.float32]


class Stroke(NamedTuple):
    """A key goes down, or comes up."""

    time: float
    """s"""
    key: int
    """0 to 87."""
    is_down: bool


def strokes_between(before: npt.NDArray[np.bool_], now: npt.NDArray[np.bool_], time: float) -> tuple[Stroke, ...]:
    """Return what happened to keys, shape (88,) each, True where a key is down, until `time` (s)."""
    return tuple(Stroke(time, int(key), bool(now[key])) for key in np.flatnonzero(before != now))


def frequency(key: int) -> float:
    """Hz of a key's fundamental, equally tempered."""
    return float(_CONCERT_A * 2.0 ** ((key - _A4) / 12.0))


class PianoSound:
    """Sound of strokes as they come, without end: what was asked for once is not kept."""

    def __init__(self) -> None:
        self._next = 0
        self._notes: list[_Note] = []

    def strike(self, strokes: Iterable[Stroke]) -> None:
        """Take strokes in order of time; those before what has been heard sound from there on."""
        for stroke in strokes:
            sample = max(round(stroke.time * RATE), self._next)
            for note in self._notes:
                if note.key == stroke.key and note.released is None:
                    note.released = sample
            if stroke.is_down:
                self._notes.append(_Note(stroke.key, sample))

    def until(self, time: float) -> Samples:
        """Return what is heard from where the last answer ended to `time` (s), shape (N,), -1 to 1, `RATE` a second."""
        first, end = self._next, max(round(time * RATE), self._next)
        total = np.zeros(end - first)
        for note in self._notes:
            note.add_to(total, first)
        self._next = end
        self._notes = [note for note in self._notes if note.ends > end]
        return _limited(total)


class _Note:
    __slots__ = ("key", "released", "start")

    def __init__(self, key: int, start: int) -> None:
        self.key, self.start = key, start
        self.released: int | None = None

    @property
    def ends(self) -> int:
        """Sample from which on it is silent."""
        whole = self.start + round(_LONGEST * RATE)
        return whole if self.released is None else min(whole, self.released + round(_SILENT * RATE))

    def add_to(self, total: FloatArray, first: int) -> None:
        """Add it to samples that begin at sample `first`."""
        begin, end = max(self.start, first), min(self.ends, first + len(total))
        if begin >= end:
            return
        heard = tone(self.key)[begin - self.start : end - self.start].astype(np.float64)
        if self.released is not None:
            damped = np.maximum(np.arange(begin, end) - self.released, 0) / RATE
            heard *= np.exp(-damped / _RELEASE) * np.clip((_SILENT - damped) / _END, 0.0, 1.0)
        total[begin - first : end - first] += heard


@lru_cache(maxsize=88)
def tone(key: int) -> Samples:
    """Return a key that is struck and held, shape (N,): partials of a stiff string, the higher the shorter.

    The fundamental is exactly the key's. Stiffness pulls the partials up, which rise as n sqrt(1 + B n²) (Fletcher
    1962); their levels are those of a string struck at an eighth of its length; each falls quickly at first, and then
    slowly, as both polarisations of a string do (Weinreich 1977).
    """
    time = np.arange(round(_LONGEST * RATE)) / RATE
    pitch = frequency(key)
    stiffness = 1e-4 * 2.0 ** ((key - _A4) / 10.0)
    rate = 0.35 + 0.6 * pitch / _CONCERT_A
    prompt, lasting = 0.75 * np.exp(-2.2 * rate * time), 0.25 * np.exp(-0.4 * rate * time)
    sooner, later = np.exp(-0.55 * rate * time), np.exp(-0.1 * rate * time)
    total = np.zeros(len(time))
    for n in range(1, 25):
        partial = n * pitch * np.sqrt((1.0 + stiffness * n * n) / (1.0 + stiffness))
        if partial > _BRIGHTEST and n > 1:
            break
        level = abs(np.sin(np.pi * n * _STRUCK_AT)) / n**1.4 / np.sin(np.pi * _STRUCK_AT)
        if level > 1e-6:
            total += level * (prompt + lasting) * np.sin(2.0 * np.pi * partial * time)
        prompt *= sooner
        lasting *= later
    total *= np.clip(time / _ATTACK, 0.0, 1.0) ** 2 * np.clip((_LONGEST - time) / _END, 0.0, 1.0)
    sound: Samples = (_LEVEL / np.abs(total).max() * total).astype(np.float32)
    return sound


def _limited(total: FloatArray) -> Samples:
    """Bent smoothly above the knee, so that no sum of notes is cut off."""
    room = _CEILING - _KNEE
    over = np.maximum(np.abs(total) - _KNEE, 0.0)
    bent: FloatArray = np.where(over > 0.0, np.sign(total) * (_KNEE + room * np.tanh(over / room)), total)
    return bent.astype(np.float32)


def write_wav(file: IO[bytes], samples: Samples) -> None:
    """Write samples, shape (N,), -1 to 1, as a WAV: 16 bits, one channel."""
    with wave.open(file, "wb") as output:
        output.setnchannels(1)
        output.setsampwidth(2)
        output.setframerate(RATE)
        output.writeframes(np.round(32767.0 * samples.astype(np.float64)).astype("<i2").tobytes())
