"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as that is known."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from time import monotonic

import mido
import numpy as np

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.song import PERCUSSION
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_MOST_BYTES = 4096  # read in one poll
_CHECK_PERIOD = 0.5  # s between two checks that a port is still there: no library reports when it goes
_RETRY = 0.5  # s between two attempts to open a keyboard that is gone
_OWN_PORTS = "Midi Through"  # of ALSA itself, which are not keyboards
_NOTE_OFF, _NOTE_ON, _CONTROL, _PROGRAM, _PRESSURE = 0x8, 0x9, 0xB, 0xC, 0xD
_ALL_OFF = (120, 123)  # controllers: all sound off, all notes off


class ByteDevice:
    """A raw MIDI byte stream: `/dev/snd/midiC1D0`, or a FIFO."""

    def __init__(self, path: str) -> None:
        self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)

    def read(self) -> bytes | None:
        """Return the new bytes; None if the device is gone."""
        try:
            return os.read(self._handle, _MOST_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        os.close(self._handle)


class Port:
    """The first port of the system's MIDI sequencer whose name has a part; '' for any."""

    def __init__(self, part: str) -> None:
        found = [name for name in port_names() if part.lower() in name.lower()]
        if not found:
            raise InputError(f"--port: no keyboard with '{part}'; ports: {', '.join(port_names()) or 'none'}")
        self._name, self._port = found[0], mido.open_input(found[0])
        self._checked = monotonic()

    def read(self) -> bytes | None:
        """Return the new bytes; None if the port is gone."""
        if monotonic() - self._checked > _CHECK_PERIOD:
            self._checked = monotonic()
            if self._name not in port_names():
                return None
        return b"".join(message.bin() for message in self._port.iter_pending())

    def close(self) -> None:
        self._port.close()


def port_names() -> list[str]:
    """Return the ports that a keyboard may be at. Raises `InputError` where there is no sequencer."""
    with blaming("--port: no MIDI sequencer; --device reads the bytes of a keyboard from a device or FIFO", Exception):
        return [name for name in mido.get_input_names() if not name.startswith(_OWN_PORTS)]


class Keyboard:
    """The keys that are down: a key is down as long as some channel holds it, whatever the pedal does."""

    def __init__(self, open_source: Callable[[], ByteDevice | Port]) -> None:
        """Open it. Raises `InputError` or `OSError` if it is not there."""
        self._open = open_source
        self._source: ByteDevice | Port | None = open_source()
        self._tried = 0.0
        self._message: list[int] = [0xFF]  # as far as it has come
        self._held: set[tuple[int, int]] = set()  # channel and key
        self.is_known = True
        """True while it is known which keys are down."""

    @property
    def pressed(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first; none of a keyboard that is gone."""
        values = np.zeros(KEY_COUNT)
        values[[key for _, key in self._held]] = 1.0
        return values

    def close(self) -> None:
        if self._source is not None:
            self._source.close()
            self._source = None

    def poll(self) -> list[str]:
        """Read what has come; a line for an operator where the keyboard goes or comes back."""
        if self._source is None and monotonic() - self._tried > _RETRY:
            self._tried = monotonic()
            with contextlib.suppress(OSError, InputError):
                self._source = self._open()
        data = None if self._source is None else self._source.read()
        was_known, self.is_known = self.is_known, data is not None
        if data is None:
            self.close()
            self._held.clear()
        for byte in data or b"":
            self._take(byte)
        if self.is_known == was_known:
            return []
        return ["the keyboard is there again" if self.is_known else "the keyboard is gone: all keys released"]

    def _take(self, byte: int) -> None:
        if byte >= 0xF8:  # real time, which may come within a message
            return
        self._message = [byte] if byte >= 0x80 else [*self._message, byte]
        kind, channel = divmod(self._message[0], 16)
        if len(self._message) < (2 if kind in (_PROGRAM, _PRESSURE) else 3):
            return
        number, value = self._message[1], self._message[-1]
        self._message = self._message[:1]  # which the next one may leave out (running status)
        if kind == _CONTROL and number in _ALL_OFF:
            self._held = {held for held in self._held if held[0] != channel}
        elif kind in (_NOTE_OFF, _NOTE_ON) and channel != PERCUSSION:
            held = (channel, number - FIRST_NOTE)
            self._held.discard(held)
            if kind == _NOTE_ON and value > 0 and 0 <= held[1] < KEY_COUNT:
                self._held.add(held)
