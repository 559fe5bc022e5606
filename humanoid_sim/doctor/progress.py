"""How far a search is, and how long it will take: a bar on a terminal, a line for each stage anywhere else."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.search import Plan

__all__ = ["SearchProgress"]


class SearchProgress:
    """Told of every trial by the search; a context."""

    def __init__(self, console: Console, ranking: Ranking, plan: Plan) -> None:
        self._console = console
        self._ranking = ranking
        self._plan = plan
        self._stage = ""
        self._started = 0.0
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task: TaskID = self._bar.add_task("")

    def __enter__(self) -> SearchProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take in that so many of a stage's hypotheses have been tried."""
        seconds = self._ranking.seconds
        if not self._stage:
            self._say(f"single changes: {total - 1}, about {self._ranking.expected:.0f} s{self._limit()}")
        if stage != self._stage:
            self._stage, self._started = stage, seconds
        self._bar.update(self._task, description=stage, completed=done, total=total)
        if done == total and not self._console.is_terminal:
            self._say(f"{stage}: {total} tried, {seconds:.0f} s so far")

    def _limit(self) -> str:
        budget = self._plan.budget
        if budget is None or not self._plan.pairs:
            return ""
        if self._ranking.expected > budget:
            return f", more than --budget {budget:g}: pairs of them will hardly be tried"
        return f"; with pairs of them at most {budget:g} s"

    def _say(self, text: str) -> None:
        self._console.print(text, style="dim", markup=False, highlight=False, soft_wrap=True)
