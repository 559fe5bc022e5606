"""The operator at a terminal: single keys become intents, changes of the velocity command, or a fresh start."""

from __future__ import annotations

import contextlib
import copy
import os
import re
import select
import sys
import termios
import tty
from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, TickOutput
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.sources import VELOCITY_HELP, VELOCITY_KEYS, IntentSource, VelocityCommand

KEYS: Mapping[str, Intent] = {
    " ": Intent.DAMP,
    "d": Intent.DAMP,
    "a": Intent.LOAD_A,
    "b": Intent.LOAD_B,
    "l": Intent.START_LOCOMOTION,
    "r": Intent.START_REMOTE,
    "q": Intent.QUIT,
}
"""Key to intent. The space bar damps: it is the key that a startled hand finds."""
REACTIVATE_KEY = "e"
KEY_HELP = (
    "keys: space or d DAMP, a LOAD_A, b LOAD_B, l START_LOCOMOTION, r START_REMOTE, e reactivate, q QUIT, "
    "h or ? this help"
)
_DAMP_KEYS = (" ", "d")
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_KEY = re.compile(r"\x1b[\[O]([A-D])|\x1b(?:\[[0-9;]*[A-Za-z~]|O[A-Z])|(.)", re.DOTALL)  # arrow, function key, other
_UNFINISHED = re.compile(r"\x1b(\[[0-9;]*|O)?$")  # the beginning of one


def key_of(intent: Intent) -> str:
    """Return the key of an intent, as operators call it."""
    key = next(key for key, meant in KEYS.items() if meant is intent)
    return "space" if key == " " else key


@dataclass(eq=False)
class Keyboard(IntentSource):
    """Reads the terminal in each tick. Restores it on `close`. Raises `InputError` without one."""

    velocity: VelocityCommand | None = None  # that the velocity keys change; None where the robot does not walk
    _: KW_ONLY
    requests: Requests = field(default_factory=Requests)
    tell: Callable[[str], None] = lambda _: None  # shows the operator a line

    def __post_init__(self) -> None:
        self._unfinished = ""  # beginning of an escape sequence
        try:
            self._fd = sys.stdin.fileno()
            self._before = termios.tcgetattr(self._fd)
            termios.tcflush(self._fd, termios.TCIFLUSH)  # typed before there was anything to drive
        except (termios.error, OSError, ValueError):
            raise InputError("--manual: standard input is not a terminal, expected one to read keys from") from None
        self.take_terminal()
        self._is_lost = False

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        if not select.select([self._fd], [], [], 0.0)[0]:
            return ()
        try:
            text = os.read(self._fd, 4096).decode(errors="replace")  # all that a terminal holds: no DAMP stays behind
        except OSError:  # a terminal that has hung up, or is another program's by now
            text = ""
        was_lost, self._is_lost = self._is_lost, not text
        if self._is_lost:  # an operator whose keys do not arrive must not be moved on
            return () if was_lost else (Intent.DAMP,)
        return self._pressed(text)

    def take_terminal(self) -> None:
        """Have the terminal send key by key and show none of them."""
        attributes = copy.deepcopy(self._before)
        attributes[tty.IFLAG] &= ~termios.IXON
        attributes[tty.LFLAG] &= ~(termios.ICANON | termios.ECHO)
        attributes[tty.CC][termios.VMIN], attributes[tty.CC][termios.VTIME] = 1, 0
        self._set(attributes)

    def close(self) -> None:
        """Give the terminal back as it was. May be called from a signal handler."""
        self._set(self._before)

    def _set(self, attributes: list[Any]) -> None:
        with contextlib.suppress(termios.error):  # the terminal has gone
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)

    def _pressed(self, text: str) -> list[Intent]:
        keys = self._keys(text)
        for key in keys:
            if key in ("h", "?"):
                self.tell(KEY_HELP if self.velocity is None else f"{KEY_HELP}; {VELOCITY_HELP}")
            elif key in VELOCITY_KEYS and self.velocity is not None:
                self.velocity.press(key)
            elif key == REACTIVATE_KEY:
                self.requests.reactivate()
        return [KEYS[key] for key in keys if key in KEYS]

    def _keys(self, text: str) -> list[str]:
        """Return the keys in what the terminal sent, in order, letters in lower case, arrows as `up`, `down` and so on.

        An arrow key sends an escape character and letters: `A` for up must not load pose A. Of what comes in one piece
        with an escape character, beside arrows only DAMP counts, and likewise of a piece that continues an unfinished
        one.
        """
        text = self._unfinished + text
        unfinished = _UNFINISHED.search(text)
        self._unfinished = unfinished[0] if unfinished else ""
        text = text[: len(text) - len(self._unfinished)]
        keys = [_ARROWS[arrow] if arrow else key.lower() for arrow, key in _KEY.findall(text)]
        return [key for key in keys if "\x1b" not in text or key in _DAMP_KEYS or key in _ARROWS.values()]
