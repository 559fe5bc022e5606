"""The operator at a terminal: single keys become intents, changes of the velocity command, or a fresh start."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import threading
from collections.abc import Callable
from time import monotonic
from types import MappingProxyType
from typing import Any

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.sources import VELOCITY_KEYS, IntentQueue, VelocityCommand, velocity_key_help

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

HELP_KEYS = ("h", "?")
_DAMP_KEYS = frozenset(key for key, intent in KEYS.items() if intent is Intent.DAMP)
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_ESCAPE = "\x1b"
_SEQUENCE = re.compile(r"\x1b(?:\[([0-9;]*)([A-Za-z~])|O([A-Z]))")
"""Sequence that an arrow key or a function key sends."""
_UNFINISHED = re.compile(r"\x1b(\[[0-9;]*|O)?$")
"""Beginning of such a sequence."""


class KeyReader:
    """Turns what a terminal sends into keys.

    An arrow key sends an escape character and letters: `A` for up must not load pose A. Of what comes in one piece with
    an escape character, beside arrows only DAMP counts, and likewise of a piece that continues an unfinished one.
    """

    def __init__(self) -> None:
        self._unfinished = ""

    def keys(self, text: str) -> list[str]:
        """Return the keys in a piece of input, in order, letters in lower case, arrows as `up`, `down` and so on.

        A key that sends something else with an escape character is all that it sends.
        """
        text = self._unfinished + text
        unfinished = _UNFINISHED.search(text)
        self._unfinished = unfinished[0] if unfinished else ""
        text = text[: len(text) - len(self._unfinished)]
        if _ESCAPE not in text:
            return list(text.lower())
        found, end = [], 0
        for sequence in _SEQUENCE.finditer(text):
            found += _beside_a_sequence(text[end : sequence.start()])
            end = sequence.end()
            arrow = sequence[3] or (sequence[2] if not sequence[1] else "")
            found.append(_ARROWS.get(arrow, sequence[0]))
        return found + _beside_a_sequence(text[end:])


def _beside_a_sequence(text: str) -> list[str]:
    """Return the DAMP keys of a text; where there is none, all of it as one key, which means nothing."""
    damps = [key for key in text.lower() if key in _DAMP_KEYS]
    return damps or ([f"{_ESCAPE}{text.removeprefix(_ESCAPE)}"] if text else [])


def key_of(intent: Intent) -> str:
    """Return the key of an intent, as operators call it."""
    key = next(key for key, meant in KEYS.items() if meant is intent)
    return "space" if key == " " else key


def key_help() -> str:
    """One line that names the keys."""
    return (
        "keys: space or d DAMP, a LOAD_A, b LOAD_B, l START_LOCOMOTION, r START_REMOTE, e reactivate, q QUIT, "
        "h or ? this help"
    )


def _by_key(attributes: list[Any]) -> list[Any]:
    """Return settings of a terminal that sends each key at once, Ctrl-S too; those that send signals still do."""
    iflag, oflag, cflag, lflag, ispeed, ospeed, characters = attributes
    characters = list(characters)
    characters[termios.VMIN], characters[termios.VTIME] = 1, 0
    lflag &= ~(termios.ICANON | termios.ECHO)
    return [iflag & ~termios.IXON, oflag, cflag, lflag, ispeed, ospeed, characters]


class Keyboard(IntentQueue):
    """Reads keys on a thread of its own and queues their intents. Restores the terminal on `close`."""

    def __init__(
        self,
        velocity: VelocityCommand | None = None,
        *,
        reactivation: Reactivation | None = None,
        tell: Callable[[str], None] = lambda _: None,
        record: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Take over the terminal. Raises `InputError` if standard input is not a terminal.

        Args:
            tell: shows the operator a line; called on the reading thread. Must not wait.
            record: records a line, and shows it; called on the loop's thread.
        """
        super().__init__(tell=record)
        self._reader = KeyReader()
        self.velocity = velocity
        """Command that the velocity keys change; None where the robot does not walk."""
        self._reactivation = reactivation
        self._show = tell
        self._stop = threading.Event()
        try:
            self._fd = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._fd)
        except (termios.error, OSError, ValueError):
            raise InputError("--manual: standard input is not a terminal, expected one to read keys from") from None
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
        """Return whether the terminal's input is meant for this process; so is that of one that controls no process."""
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
                self.put(Intent.DAMP)  # nobody at these keys can be heard
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
                self.put(Intent.DAMP)
                return
            self._heard(keys.decode(errors="replace"), is_late=monotonic() - begin > _POLL + _LATE)

    def _heard(self, text: str, *, is_late: bool) -> None:
        keys = self._reader.keys(text)
        if is_late:  # the process stood still: what was typed meanwhile was meant for something else
            termios.tcflush(self._fd, termios.TCIFLUSH)
            self._show("keys that were pressed while the process stood still are left out, but for DAMP")
            keys = [key for key in keys if key in _DAMP_KEYS]
        unknown = [key for key in keys if not self._press(key)]
        if unknown:
            named, verb = ", ".join(map(repr, unknown)), "means" if len(unknown) == 1 else "mean"
            self._show(f"the key{'s' * (len(unknown) > 1)} {named} {verb} nothing; h or ? shows those that do")

    def _press(self, key: str) -> bool:
        """Do what a key means; whether it means anything."""
        if key in KEYS:
            self.put(KEYS[key], monotonic_ns())
        elif key in HELP_KEYS:
            for line in (key_help(),) if self.velocity is None else (key_help(), velocity_key_help()):
                self._show(line)
        elif self.velocity is not None and key in VELOCITY_KEYS:
            before = self.velocity.command
            self.velocity.press(key)
            if any(VELOCITY_KEYS[key]) and (self.velocity.command == before).all():
                self._show("the velocity command is at its limit: {:g} m/s, {:g} m/s, {:g} rad/s".format(*before))
        elif self._reactivation is not None and key == REACTIVATE_KEY:
            self._reactivation.request()
        else:
            return False
        return True
