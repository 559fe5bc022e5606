"""The operator at a terminal: single keys become intents, changes of the velocity command, or a fresh start."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable, Sequence
from types import MappingProxyType

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.sources import VELOCITY_KEYS, IntentQueue, IntentSource, VelocityCommand, velocity_key_help

__all__ = ["KEYS", "REACTIVATE_KEY", "KeyReader", "Keyboard", "key_help"]

KEYS = MappingProxyType(
    {
        " ": Intent.DAMP,
        "d": Intent.DAMP,
        "a": Intent.LOAD_A,
        "b": Intent.LOAD_B,
        "l": Intent.START_LOCOMOTION,
        "r": Intent.START_REMOTE,
        "q": Intent.QUIT,
    }
)
"""Key to intent. The space bar damps: it is the key that a startled hand finds."""
REACTIVATE_KEY = "e"

_POLL = 0.1
"""s between two looks at whether to stop."""


_ESCAPE = "\x1b"
_UNFINISHED = re.compile(r"\x1b(\[[0-9;]*|O)?$")
"""The beginning of what an arrow key or a function key sends."""


class KeyReader:
    """From what a terminal sends to intents.

    An arrow key sends an escape character and letters: `A` for up must not load pose A. Of what comes in one piece with
    an escape character only DAMP counts, and likewise of a piece that continues an unfinished one.
    """

    def __init__(self) -> None:
        """Start with no sequence under way."""
        self._unfinished = ""

    def intents(self, text: str) -> list[Intent]:
        """The intents in a piece of input, in order."""
        text = self._unfinished + text
        unfinished = _UNFINISHED.search(text)
        self._unfinished = unfinished[0] if unfinished else ""
        found = [KEYS[key] for key in text.lower() if key in KEYS]
        return [intent for intent in found if intent is Intent.DAMP] if _ESCAPE in text else found


def key_help() -> str:
    """One line that names the keys."""
    return "keys: space or d DAMP, a LOAD_A, b LOAD_B, l START_LOCOMOTION, r START_REMOTE, e reactivate, q QUIT"


class Keyboard(IntentSource):
    """Reads keys on a thread of its own and queues their intents. Restores the terminal on `close`."""

    def __init__(
        self,
        velocity: VelocityCommand | None = None,
        *,
        reactivation: Reactivation | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Take over the terminal.

        Args:
            velocity: the command that the velocity keys change, if the robot walks.
            reactivation: what the key for it asks for.
            tell: shows the operator a line; called on the reading thread, once, at the first key that means nothing.

        Raises:
            InputError: if standard input is no terminal.
        """
        self._queue = IntentQueue()
        self._reader = KeyReader()
        self._velocity = velocity
        self._reactivation = reactivation
        self._tell: Callable[[str], None] | None = tell
        self._stop = threading.Event()
        try:
            self._fd = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._fd)
        except (termios.error, OSError, ValueError):
            raise InputError("--manual: standard input is no terminal, expected one to read keys from") from None
        tty.setcbreak(self._fd)
        self._thread = threading.Thread(target=self._read, name="keyboard", daemon=True)
        self._thread.start()

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Intents of the keys pressed since the last call."""
        return self._queue.poll(time, output)

    def close(self) -> None:
        """Stop reading and give the terminal back as it was."""
        self._stop.set()
        self._thread.join()
        with contextlib.suppress(termios.error):  # there is no terminal left to give back
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)

    def _read(self) -> None:
        while not self._stop.is_set():
            ready, _, _ = select.select([self._fd], [], [], _POLL)
            if not ready:
                continue
            try:
                keys = os.read(self._fd, 64)
            except OSError:  # a terminal that has hung up
                keys = b""
            if not keys:  # the terminal went away: an operator who cannot be heard must not be moved on
                self._queue.put(Intent.DAMP)
                return
            text = keys.decode(errors="replace")
            for intent in self._reader.intents(text):
                self._queue.put(intent)
            if _ESCAPE not in text:
                self._press(text.lower())

    def _press(self, keys: str) -> None:
        """Do what keys mean that are no intents; at the first that means nothing, tell the operator which do."""
        if self._velocity is not None:
            for key in keys:
                self._velocity.press(key)
        if self._reactivation is not None and REACTIVATE_KEY in keys:
            self._reactivation.request()
        known = {*KEYS, REACTIVATE_KEY, *(VELOCITY_KEYS if self._velocity is not None else ())}
        unknown = [key for key in keys if key not in known]
        if unknown and self._tell is not None:
            help_lines = (key_help(), velocity_key_help()) if self._velocity is not None else (key_help(),)
            self._tell(f"the key {unknown[0]!r} means nothing; {'; '.join(help_lines)}")
            self._tell = None
