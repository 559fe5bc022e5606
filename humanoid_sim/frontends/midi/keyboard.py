"""A MIDI keyboard that may be unplugged and come back: which keys are down, as long as that is known."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Callable, Iterator
from time import monotonic

import mido
import numpy as np
from mido.messages.specs import SPEC_BY_STATUS

from humanoid_sim.errors import InputError, blaming, reason_of
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.song import PERCUSSION
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_MOST_BYTES = 4096  # taken in one poll
_CHECK_PERIOD = 0.5  # s between two checks that a port is still there: no library reports when it goes
_RETRY = 0.5  # s between two attempts to find a keyboard that is gone
_OWN_PORTS = "Midi Through"  # of ALSA itself, which are not keyboards
_ALL_OFF = (120, 123, 124, 125, 126, 127)  # controllers: all sound off, all notes off, and the changes of mode


class PressedKeys:
    """A key is down as long as some channel holds it. The pedal holds strings, not keys: it changes nothing here."""

    def __init__(self, transpose: int = 0) -> None:
        """Begin with none; `transpose` in semitones is added to every note."""
        self._transpose = transpose
        self._held: set[tuple[int, int]] = set()  # channel and key

    @property
    def values(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first."""
        values = np.zeros(KEY_COUNT)
        values[[key for _, key in self._held]] = 1.0
        return values

    def release(self) -> None:
        """Release all."""
        self._held.clear()

    def take(self, message: mido.Message) -> None:
        """Take a message; notes of drums and beyond the piano's keys count as no keys."""
        if message.type == "reset":
            self._held.clear()
        elif message.type == "control_change" and message.control in _ALL_OFF:
            self._held = {held for held in self._held if held[0] != message.channel}
        elif message.type in ("note_on", "note_off") and message.channel != PERCUSSION:
            key = message.note + self._transpose - FIRST_NOTE
            self._held.discard((message.channel, key))
            if message.type == "note_on" and message.velocity > 0 and 0 <= key < KEY_COUNT:
                self._held.add((message.channel, key))


class WireParser:
    """mido's parser, for a wire: a message may come without its status byte if it is that of the message before."""

    def __init__(self) -> None:
        self._parser = mido.Parser()
        self._status = self._missing = 0

    def feed(self, data: bytes) -> Iterator[mido.Message]:
        """Yield the messages that these bytes complete."""
        for byte in data:
            if byte >= 0xF8:  # real time, which may come within a message: the parser would drop that message
                if byte == 0xFF:
                    yield mido.Message("reset")
                continue
            if byte >= 0x80:
                self._status = byte if byte < 0xF0 else 0
                self._missing = self._length
            elif self._status:
                if not self._missing:
                    self._parser.feed_byte(self._status)
                    self._missing = self._length
                self._missing -= 1
            self._parser.feed_byte(byte)
            yield from self._parser

    @property
    def _length(self) -> int:
        """Number of data bytes of a message with this status."""
        return int(SPEC_BY_STATUS[self._status]["length"]) - 1 if self._status else 0


class ByteDevice:
    """A raw MIDI byte stream: `/dev/snd/midiC1D0`, or a FIFO."""

    def __init__(self, path: str) -> None:
        """Open it. Raises `InputError` if it cannot be, or has no time, and `ConnectionError` if nobody writes."""
        self.name, self._parser = path, WireParser()
        with blaming(f"--device: {path} cannot be opened", OSError):
            self._handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
        kind = os.fstat(self._handle).st_mode
        if not (stat.S_ISCHR(kind) or stat.S_ISFIFO(kind)):
            self.close()
            raise InputError(f"--device: {path} is a file or folder, expected a MIDI device or a FIFO")
        self._first: list[mido.Message] | None = None
        first = self.read()
        if first is None:
            self.close()
            raise ConnectionError
        self._first = first

    def read(self) -> list[mido.Message] | None:
        """Return what has come."""
        first, self._first = self._first or [], None
        try:
            data = os.read(self._handle, _MOST_BYTES)
        except BlockingIOError:
            return first
        except OSError:  # a device that was unplugged
            return None
        return [*first, *self._parser.feed(data)] if data else None

    def close(self) -> None:
        """Close it."""
        os.close(self._handle)


class Port:
    """A port of the system's MIDI sequencer."""

    def __init__(self, wanted: str) -> None:
        """Open the first port whose name has that part; '' for any. Raises `InputError` or `ConnectionError`."""
        found = [name for name in port_names() if wanted.lower() in name.lower()]
        if not found:
            raise ConnectionError
        self.name = found[0]
        try:
            self._port = mido.open_input(self.name)
        except Exception as error:  # of the library's own kinds
            raise InputError(f"--port: {self.name} cannot be opened: {reason_of(error)}") from None
        self._checked = monotonic()

    def read(self) -> list[mido.Message] | None:
        """Return what has come."""
        messages = list(self._port.iter_pending())
        if monotonic() - self._checked > _CHECK_PERIOD:
            self._checked = monotonic()
            if self.name not in port_names():
                return None
        return messages

    def close(self) -> None:
        """Close it."""
        self._port.close()


def port_names() -> list[str]:
    """Return the ports that a keyboard may be at. Raises `InputError` where there is no sequencer."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)  # ALSA's own complaint on stderr is left out: ours is one line
    try:
        names = mido.get_input_names()
    except Exception as error:  # of the library's own kinds
        reason = f"no MIDI sequencer: {reason_of(error)}"
        raise InputError(f"--port: {reason}; --device takes the bytes of a keyboard from a device or FIFO") from None
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
    return [name for name in names if not name.startswith(_OWN_PORTS)]


Source = ByteDevice | Port
"""A keyboard that is there; `read` returns None once it is gone."""


class Keyboard:
    """A source that is opened again where it was lost."""

    def __init__(self, source: Source, again: Callable[[], Source], transpose: int = 0) -> None:
        """Take over a source; `again` opens it anew, or raises as its constructor."""
        self._source: Source | None = source
        self._again, self._keys = again, PressedKeys(transpose)
        self._name, self._tried = source.name, 0.0

    @property
    def is_known(self) -> bool:
        """Return whether it is known which keys are down."""
        return self._source is not None

    @property
    def pressed(self) -> FloatArray:
        """Shape (88,): 1 for each key that is down, else 0, A0 first; none of a keyboard that is gone."""
        return self._keys.values

    def close(self) -> None:
        """Close it."""
        if self._source is not None:
            self._source.close()
            self._source = None

    def poll(self) -> list[str]:
        """Take what has come; lines for an operator."""
        if self._source is None:
            if monotonic() - self._tried < _RETRY:
                return []
            self._tried = monotonic()
            with contextlib.suppress(ConnectionError, InputError):  # an unplugged device has no name either
                self._source = self._again()
            return [f"{self._name} is there again"] if self._source is not None else []
        messages = self._source.read()
        for message in messages or ():
            self._keys.take(message)
        if messages is None:
            self._keys.release()
            self.close()
            return [f"{self._name} is gone: all keys released"]
        return []
