"""The emulated piano's keys as a MIDI keyboard says them: bytes on a FIFO."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from pathlib import Path
from time import monotonic

import numpy as np

from humanoid_sim.errors import blaming
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.piano import FIRST_NOTE, KEY_COUNT

_PERIOD = 0.002
"""s between two looks at the keys, as long as a keyboard takes for one."""
_SENSING_PERIOD = 0.1
"""s between two bytes of active sensing, which says that the keyboard is there; 0.3 is allowed."""
_NOTE_ON, _ACTIVE_SENSING, _VELOCITY = 0x90, 0xFE, 64


class MidiKeyboard:
    """Sends until `close`. Keys that are released are note on with velocity 0, as many keyboards have it."""

    def __init__(self, path: Path, pressed: Callable[[], FloatArray]) -> None:
        """Make the FIFO, where nothing may be, and begin; an `InputError` if it cannot be made.

        Args:
            pressed: shape (88,), 1 for each key that is down, else 0; called on a thread of its own.
        """
        self.path = path
        self._pressed = pressed
        self._told = np.zeros(KEY_COUNT)
        self._sensed = -np.inf
        with blaming(f"'{path}': no FIFO for a MIDI keyboard can be made", OSError):
            os.mkfifo(path, 0o600)
        self._handle = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="MIDI keyboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Unplug it and remove the FIFO. May be called twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
            os.close(self._handle)
            self.path.unlink(missing_ok=True)

    def _run(self) -> None:
        while not self._stop.wait(_PERIOD):
            pressed, now = self._pressed(), monotonic()
            data = message(self._told, pressed)
            if now - self._sensed >= _SENSING_PERIOD:
                data += bytes((_ACTIVE_SENSING,))
            if data:
                with contextlib.suppress(BlockingIOError):  # nobody reads: it is said again
                    os.write(self._handle, data)
                    self._told, self._sensed = pressed, now


def message(before: FloatArray, now: FloatArray) -> bytes:
    """Get the bytes that say which keys have changed, both shape (88,); with running status, as keyboards send them."""
    data = b"".join(
        bytes((FIRST_NOTE + key, _VELOCITY if now[key] > 0.0 else 0)) for key in np.flatnonzero(now != before).tolist()
    )
    return bytes((_NOTE_ON,)) + data if data else b""
