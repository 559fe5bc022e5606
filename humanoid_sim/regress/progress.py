"""Progress of episodes, and how long the rest will take."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from rich.console import Console
from rich.progress import TimeRemainingColumn

from humanoid_sim.command_line.progress import BarOrLines


class EpisodeProgress(BarOrLines):
    """A context that is called with how many episodes have just ended."""

    def __init__(self, console: Console, label: str, total: int, clock: Callable[[], float] = perf_counter) -> None:
        """Start at none.

        Args:
            label: whose episodes these are; empty to show nothing.
        """
        super().__init__(console, label, total, TimeRemainingColumn())
        self._label, self._done, self._total = label, 0, total
        self._clock, self._begin = clock, clock()

    def __call__(self, count: int) -> None:
        """Take in that so many more have ended."""
        self._done += count
        self.advance(self._task, count)
        elapsed = self._clock() - self._begin
        if self._label and self._done < self._total and self.is_due(elapsed):
            left = elapsed * (self._total - self._done) / max(self._done, 1)
            self.say(elapsed, f"{self._label}: episodes {self._done} of {self._total}, about {left:.0f} s left")
