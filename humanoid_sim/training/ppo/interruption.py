"""Ctrl-C during a training: the first ends it after the update that is being made, the second at once."""

from __future__ import annotations

import contextlib
import os
import signal
from types import FrameType, TracebackType
from typing import Any, Self

__all__ = ["Interruption"]

_LINE = b"Ctrl-C: ends after this update, with a checkpoint; once more ends at once\n"


class Interruption:
    """Within it the first SIGINT is only noted, and gives way to the handler that was there before.

    Only the main thread may enter it.
    """

    def __init__(self) -> None:
        self._before: Any = None
        self.is_asked_for = False
        """Whether somebody has asked for the training's end."""

    def __enter__(self) -> Self:
        """Begin to note, unless the process is to ignore SIGINT, as one in a shell's background is."""
        self._before = signal.getsignal(signal.SIGINT)
        if self._before is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, _: int, __: FrameType | None) -> None:
        self.is_asked_for = True
        signal.signal(signal.SIGINT, self._before)
        with contextlib.suppress(OSError):
            os.write(2, _LINE)  # not print, which may be in the middle of another line

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Leave the handler as it was."""
        signal.signal(signal.SIGINT, self._before)
