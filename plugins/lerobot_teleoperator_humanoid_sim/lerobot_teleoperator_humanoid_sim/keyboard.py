"""Where keys come from: the terminal, whatever else is standard input, or a text."""

import os
import select
import sys
import termios
import time
import tty
from typing import Any


class Typed:
    """A text that types itself from the first look on, one key every `period` s."""

    def __init__(self, keys: str, period: float) -> None:
        self._keys, self._period = keys, period
        self._start: float | None = None
        self._pressed = 0

    def pressed(self) -> str:
        """Return what was pressed since the last look."""
        now = time.monotonic()
        self._start = now if self._start is None else self._start
        due = 1 + int((now - self._start) / self._period)
        keys, self._pressed = self._keys[self._pressed : due], due
        return keys

    def close(self) -> None:
        """Do nothing."""


class Terminal:
    """Standard input without waiting for Enter, over a remote shell too; it needs no display."""

    def __init__(self) -> None:
        """Let single keys through, if a terminal is there and this program is in its foreground."""
        self._input = sys.stdin.fileno()
        self._before: list[Any] | None = None
        if os.isatty(self._input):
            if os.tcgetpgrp(self._input) == os.getpgrp():
                self._before = termios.tcgetattr(self._input)
                tty.setcbreak(self._input)
            else:  # reading would stop the program
                self._input = -1

    def pressed(self) -> str:
        """Return what was pressed since the last look."""
        keys = b""
        while self._input >= 0 and select.select([self._input], [], [], 0.0)[0]:
            new = os.read(self._input, 1024)
            if not new:
                self._input = -1
            keys += new
        return keys.decode(errors="ignore")

    def close(self) -> None:
        """Give the terminal back as it was."""
        if self._before is not None:
            termios.tcsetattr(self._input, termios.TCSADRAIN, self._before)
            self._before = None
