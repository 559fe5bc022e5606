"""Progress of a search, and the time left: a bar on a terminal, a line now and then anywhere else."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.search import Plan

_EVERY = 10.0
"""s between two lines where nobody watches."""


class SearchProgress:
    """Told of every trial by the search; a context."""

    def __init__(self, console: Console, ranking: Ranking, plan: Plan) -> None:
        self._console = console
        self._ranking = ranking
        self._plan = plan
        self._stage = ""
        self._said = 0.0
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
        """Take in that so many of a stage's changes have been tried."""
        seconds = self._ranking.seconds
        if not self._stage:
            limit = "" if self._plan.budget is None else f"; the search ends after {self._plan.budget:.0f} s (--budget)"
            self._say(f"single changes: {total}{limit}")
        if stage != self._stage:
            self._stage = stage
        self._bar.update(self._task, description=stage, completed=done, total=total)
        if self._console.is_terminal or (done < total and seconds - self._said < _EVERY):
            return
        self._said = seconds
        tried = f"{total}" if done == total else f"{done} of {total}"
        self._say(f"{stage}: {tried} tried, {seconds:.0f} s so far")

    def _say(self, text: str) -> None:
        self._console.print(text, style="dim", markup=False, highlight=False, soft_wrap=True)
