"""The operator at a terminal: single keys become intents, changes of the velocity command, or a fresh start."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import threading
from collections.abc import Callable, Sequence
from time import monotonic
from types import MappingProxyType
from typing import Any

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
_LATE = 0.2
"""s beyond that by which a process that runs is never late."""

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


def _by_key(attributes: list[Any]) -> list[Any]:
    """Settings of a terminal that sends each key at once, Ctrl-S too; those that send signals go on sending them."""
    iflag, oflag, cflag, lflag, ispeed, ospeed, characters = attributes
    characters = list(characters)
    characters[termios.VMIN], characters[termios.VTIME] = 1, 0
    lflag &= ~(termios.ICANON | termios.ECHO)
    return [iflag & ~termios.IXON, oflag, cflag, lflag, ispeed, ospeed, characters]


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
        self.take_terminal()
        self._thread = threading.Thread(target=self._read, name="keyboard", daemon=True)
        self._thread.start()

    def take_terminal(self) -> None:
        """Have the terminal send key by key and show none of them, unless another program has it at present."""
        if self._is_in_foreground():
            self._set(_by_key(self._before))

    def restore_terminal(self) -> None:
        """Give the terminal back as it was, unless another program has it. May be called from a signal handler."""
        if self._is_in_foreground():
            self._set(self._before)

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Intents of the keys pressed since the last call."""
        return self._queue.poll(time, output)

    def close(self) -> None:
        """Stop reading and give the terminal back as it was."""
        self._stop.set()
        self._thread.join()
        self.restore_terminal()

    def _set(self, attributes: list[Any]) -> None:
        """At once: a terminal whose output stands still would keep whoever waits for it waiting."""
        with contextlib.suppress(termios.error):  # there is no terminal any more
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)

    def _is_in_foreground(self) -> bool:
        """Whether the terminal's input is meant for this process; so is that of one that controls no process."""
        try:
            return os.tcgetpgrp(self._fd) == os.getpgrp()
        except OSError:
            return True

    def _read(self) -> None:
        was_in_foreground = self._is_in_foreground()
        while not self._stop.is_set():
            begin = monotonic()
            ready, _, _ = select.select([self._fd], [], [], _POLL)
            is_in_foreground = self._is_in_foreground()
            if was_in_foreground and not is_in_foreground:
                self._queue.put(Intent.DAMP)  # nobody at these keys can be heard
            if is_in_foreground and not was_in_foreground:
                self.take_terminal()
            was_in_foreground = is_in_foreground
            if not is_in_foreground:
                self._stop.wait(_POLL)
                continue
            if not ready:
                continue
            try:
                keys = os.read(self._fd, 64)
            except OSError:  # a terminal that has hung up, or is another program's by now
                keys = b""
            if not keys and not self._is_in_foreground():
                continue
            if not keys:  # the terminal went away: an operator who cannot be heard must not be moved on
                self._queue.put(Intent.DAMP)
                return
            self._heard(keys.decode(errors="replace"), is_late=monotonic() - begin > _POLL + _LATE)

    def _heard(self, text: str, *, is_late: bool) -> None:
        intents = self._reader.intents(text)
        if is_late:  # the process stood still: what was typed meanwhile was meant for something else
            termios.tcflush(self._fd, termios.TCIFLUSH)
            intents = [intent for intent in intents if intent is Intent.DAMP]
        for intent in intents:
            self._queue.put(intent)
        if _ESCAPE not in text and not is_late:
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
