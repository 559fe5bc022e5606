"""Progress of episodes, and how long the rest will take: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

_EVERY = 10.0
"""s between two lines where nobody watches."""


class EpisodeProgress(Progress):
    """A context that is called with how many episodes have just ended."""

    def __init__(self, console: Console, label: str, total: int, clock: Callable[[], float] = perf_counter) -> None:
        """Start at none.

        Args:
            label: whose episodes these are; empty to show nothing.
        """
        columns = TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn()
        is_hidden = not label or not console.is_terminal
        super().__init__(*columns, TimeRemainingColumn(), console=console, transient=True, disable=is_hidden)
        self._label, self._done, self._total = label, 0, total
        self._clock = clock
        self._begin = self._said = clock()
        self._episodes = self.add_task(label, total=total)

    def __call__(self, count: int) -> None:
        """Take in that so many more have ended."""
        self._done += count
        self.advance(self._episodes, count)
        now = self._clock()
        if not self._label or self.console.is_terminal or now - self._said < _EVERY or self._done >= self._total:
            return
        self._said = now
        left = (now - self._begin) * (self._total - self._done) / max(self._done, 1)
        text = f"{self._label}: episodes {self._done} of {self._total}, about {left:.0f} s left"
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)
