"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as that is known."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable
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
_ALL_OFF = (120, 123)  # controllers: all sound off, all notes off


class ByteDevice:
    """A raw MIDI byte stream: `/dev/snd/midiC1D0`, or a FIFO."""

    def __init__(self, path: str) -> None:
        self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        self._parser = mido.Parser()
        self._status, self._count = 0, 0  # of the latest channel message, and its data bytes so far

    def read(self) -> list[mido.Message] | None:
        """Return the new messages; None if the device is gone."""
        try:
            data = os.read(self._handle, _MOST_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            return None
        self._parser.feed(self._written_out(data))
        return list(self._parser) if data else None

    def _written_out(self, data: bytes) -> bytearray:
        """Put a status byte before each message, which keyboards leave out where it repeats (running status)."""
        written = bytearray()
        for byte in data:
            if byte >= 0xF8:  # real time, which may come within a message
                continue
            if byte >= 0x80:
                self._status, self._count = byte if byte < 0xF0 else 0, 0
            elif self._status and self._count == (1 if self._status >> 4 in (0xC, 0xD) else 2):
                written.append(self._status)
                self._count = 0
            self._count += byte < 0x80
            written.append(byte)
        return written

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

    def read(self) -> list[mido.Message] | None:
        """Return the new messages; None if the port is gone."""
        if monotonic() - self._checked > _CHECK_PERIOD:
            self._checked = monotonic()
            if self._name not in port_names():
                return None
        return list(self._port.iter_pending())

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
        messages = None if self._source is None else self._source.read()
        was_known, self.is_known = self.is_known, messages is not None
        if messages is None:
            self.close()
            self._held.clear()
        else:
            self._update(messages)
        if self.is_known == was_known:
            return []
        return ["the keyboard is there again" if self.is_known else "the keyboard is gone: all keys released"]

    def _update(self, messages: Iterable[mido.Message]) -> None:
        for message in messages:
            if message.type == "control_change" and message.control in _ALL_OFF:
                self._held = {held for held in self._held if held[0] != message.channel}
            elif message.type in ("note_on", "note_off") and message.channel != PERCUSSION:
                held = (message.channel, message.note - FIRST_NOTE)
                self._held.discard(held)
                if message.type == "note_on" and message.velocity > 0 and 0 <= held[1] < KEY_COUNT:
                    self._held.add(held)
