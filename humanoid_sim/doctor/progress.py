"""Progress of a search, and the time that it has taken."""

from __future__ import annotations

from rich.console import Console
from rich.progress import TimeElapsedColumn

from humanoid_sim.command_line.progress import BarOrLines
from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.search import Plan


class SearchProgress(BarOrLines):
    """A context that the search calls with every trial."""

    def __init__(self, console: Console, ranking: Ranking, plan: Plan) -> None:
        super().__init__(console, "single changes", None, TimeElapsedColumn())
        self._ranking, self._plan = ranking, plan
        self._has_begun = False

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take in that so many of a stage's changes have been tried."""
        elapsed = self._ranking.seconds
        if not self._has_begun:
            self._has_begun = True
            limit = "" if self._plan.budget is None else f"; the search ends after {self._plan.budget:.0f} s (--budget)"
            self.say(0.0, f"single changes: {total}{limit}", "dim")
        self.update(self._task, description=stage, completed=done, total=total)
        if not self.console.is_terminal and (done == total or self.is_due(elapsed)):
            tried = f"{total}" if done == total else f"{done} of {total}"
            self.say(elapsed, f"{stage}: {tried} tried, {elapsed:.0f} s so far", "dim")
