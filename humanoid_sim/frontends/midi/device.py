"""Sources of a MIDI keyboard's bytes: a device or FIFO with the bytes as they are on the wire, or a port."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import select
import stat
import struct
import sys
import termios
import tty
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from humanoid_sim.errors import InputError, blaming, reason_of

STANDARD_INPUT = "-"
_MOST_BYTES = 256
"""Bytes that are taken at once: 80 ms of them on a MIDI cable."""
_MOST_MESSAGES = 64
"""Messages that are taken at once from a port."""
_ALSA_LOOK = 0.5
"""s between two checks that a port is still there: no library reports when it goes."""
_PAUSE = 0.002
"""s between two looks at a port."""
_SEQUENCER = "/dev/snd/seq"
_OWN_PORTS = "Midi Through"
"""Ports of ALSA itself, which are not keyboards."""
_GET_TERMIOS, _SET_TERMIOS = 0x802C542A, 0x402C542B
_TERMIOS = struct.Struct("<4IB19s2I")
"""Linux's `termios2`: four words of flags, of which the third holds the rate's kind; line and characters; the rates."""
_RATE_KIND, _ANY_RATE = 0o010017, 0o010000


class Source(ABC):
    """A keyboard that is there."""

    name: str

    @abstractmethod
    def read(self, seconds: float) -> bytes | None:
        """Say what has come, waiting for it for at most so long; empty for nothing, None once the keyboard is gone."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it."""


class ByteDevice(Source):
    """A raw MIDI byte stream: `/dev/snd/midiC1D0`, a serial line, a terminal, a FIFO, or standard input."""

    def __init__(self, path: str, baud: int) -> None:
        """Open it.

        Args:
            path: `-` for standard input.
            baud: of a serial line.

        Raises:
            InputError: it cannot be opened, or is a file, whose notes have no time.
            ConnectionError: it is there, and nobody at its other end.
        """
        self.name = "standard input" if path == STANDARD_INPUT else path
        self._is_own = path != STANDARD_INPUT
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
        with blaming(f"--device: {self.name} cannot be opened", OSError):
            self._handle = os.open(path, flags) if self._is_own else sys.stdin.fileno()
        self._first: bytes = b""
        try:
            self._begin(baud)
        except BaseException:
            self.close()
            raise

    def _begin(self, baud: int) -> None:
        kind = os.fstat(self._handle).st_mode
        is_terminal = os.isatty(self._handle)
        if stat.S_ISREG(kind) or stat.S_ISDIR(kind) or stat.S_ISBLK(kind) or (is_terminal and not self._is_own):
            what = "a terminal" if is_terminal else "a file or folder"
            accepted = "a MIDI device, a serial line or a FIFO" if self._is_own else "a pipe with a keyboard's bytes"
            raise InputError(f"--device: {self.name} is {what}, expected {accepted}")
        if not self._is_own:
            return
        if is_terminal:
            _make_raw(self._handle, baud)
        first = self._take()
        if first is None:
            raise ConnectionError
        self._first = first

    def read(self, seconds: float) -> bytes | None:
        """Return what has come."""
        if self._first:
            first, self._first = self._first, b""
            return first
        readable, _, _ = select.select([self._handle], [], [], seconds)
        return self._take() if readable else b""

    def _take(self) -> bytes | None:
        try:
            return os.read(self._handle, _MOST_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno in (errno.EIO, errno.ENODEV, errno.ENXIO):
                return None
            raise InputError(f"--device: {self.name} cannot be read: {error.strerror}") from None

    def close(self) -> None:
        """Close it."""
        if self._is_own:
            os.close(self._handle)


def _make_raw(terminal: int, baud: int) -> None:
    """Have a terminal hand on every byte as it is, and a serial line run at a rate that no standard of terminals has.

    Raises `InputError` if the line cannot.
    """
    try:
        tty.setraw(terminal)
        flags = list(_TERMIOS.unpack(fcntl.ioctl(terminal, _GET_TERMIOS, bytes(_TERMIOS.size))))
        flags[2] = flags[2] & ~_RATE_KIND | _ANY_RATE
        flags[-2:] = baud, baud
        fcntl.ioctl(terminal, _SET_TERMIOS, _TERMIOS.pack(*flags))
    except (OSError, termios.error) as error:
        raise InputError(f"--device: its line cannot be set to {baud} baud: {error}") from None


class Port(Source):
    """A port of the system's MIDI sequencer, through python-rtmidi."""

    def __init__(self, wanted: str) -> None:
        """Open the first port whose name has that part; '' for any but the sequencer's own.

        Raises:
            InputError: there is no sequencer.
            ConnectionError: there is no such port.
        """
        self._input = _midi_input()
        names = self._input.get_ports()
        found = next((i for i, name in enumerate(names) if _fits(name, wanted)), None)
        if found is None:
            self._input.delete()
            raise ConnectionError
        self.name = names[found]
        self._input.ignore_types(sysex=True, timing=True, active_sense=False)
        try:
            self._input.open_port(found, "keys")
        except Exception as error:  # of the library's own kinds
            self._input.delete()
            raise InputError(f"--port: {self.name} cannot be opened: {reason_of(error)}") from None
        self._looked = monotonic()

    def read(self, seconds: float) -> bytes | None:
        """Return what has come."""
        deadline = monotonic() + seconds
        while True:
            taken = islice(iter(self._input.get_message, None), _MOST_MESSAGES)
            data = b"".join(bytes(message) for message, _ in taken)
            now = monotonic()
            if data:
                return data
            if now - self._looked > _ALSA_LOOK:
                self._looked = now
                if self.name not in self._input.get_ports():
                    return None
            if now >= deadline:
                return b""
            sleep(min(_PAUSE, max(deadline - now, 0.0)))

    def close(self) -> None:
        """Close it."""
        self._input.close_port()
        self._input.delete()


def port_names() -> list[str]:
    """Return the ports that a keyboard may be at. Raises `InputError` where there is no sequencer."""
    opened = _midi_input()
    try:
        return [name for name in opened.get_ports() if _fits(name, "")]
    finally:
        opened.delete()


def _fits(name: str, wanted: str) -> bool:
    return wanted.lower() in name.lower() if wanted else not name.startswith(_OWN_PORTS)


def _midi_input() -> Any:
    """Return an input of the library's. ALSA's own complaint on stderr is left out: ours is one line.

    Raises `InputError` if there is no sequencer.
    """
    import rtmidi  # noqa: PLC0415 - an extra

    with _silent_stderr():
        try:
            return rtmidi.MidiIn(name="humanoid_sim")
        except Exception as error:  # of the library's own kinds
            is_missing = sys.platform.startswith("linux") and not Path(_SEQUENCER).exists()
            problem = f"no MIDI sequencer: {_SEQUENCER} is missing" if is_missing else reason_of(error)
    raise InputError(f"--port: {problem}; --device takes the bytes of a keyboard from a device or FIFO")


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
