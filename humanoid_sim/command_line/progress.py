"""Progress of a program: a bar on a terminal, a line now and then anywhere else."""

from __future__ import annotations

import contextlib
from time import monotonic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn

_EVERY = 10.0
"""s between two lines where nobody watches."""


class BarOrLines(Progress):
    """A context, of one task. An empty label shows no bar; `time` is its last column."""

    def __init__(self, console: Console, label: str, total: int | None, time: ProgressColumn) -> None:
        columns = TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), time
        super().__init__(*columns, console=console, transient=True, disable=not (label and console.is_terminal))
        self._task = self.add_task(label, total=total)
        self._said = 0.0

    def is_due(self, elapsed: float) -> bool:
        """Tell whether it is time for a line: nobody watches, and the last one was long ago."""
        return not self.console.is_terminal and elapsed - self._said >= _EVERY

    def say(self, elapsed: float, text: str, style: str = "") -> None:
        """Print a line, so many s after the beginning."""
        self._said = elapsed
        self.console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


class PoseProgress(BarOrLines):
    """A context, called with how many poses are drawn and their total. What cannot be printed spoils no file."""

    def __init__(self, console: Console, label: str) -> None:
        super().__init__(console, label, None, TimeRemainingColumn())
        self._label, self._begin = label, monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Show how far it is."""
        self.update(self._task, completed=done, total=total)
        elapsed = monotonic() - self._begin
        if self.is_due(elapsed):
            with contextlib.suppress(OSError):
                self.say(elapsed, f"{self._label}: {done} of {total} poses")
