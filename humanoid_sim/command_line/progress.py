"""Progress of a program: a bar on a terminal, a line now and then anywhere else."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn

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
