"""Batches of episodes to be run, and who runs them: this process, or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from humanoid_sim.regress.arena import Arena
from humanoid_sim.regress.episodes import Disturbance, run_episodes
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Suite

__all__ = ["Executor", "Job", "LocalExecutor", "Progress"]

Progress = Callable[[int], None]
"""Told how many episodes have just ended."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Episodes of one policy and one case."""

    arena: Arena
    seeds: tuple[int, ...]
    disturbance: Disturbance


class Executor(Protocol):
    """Runs jobs. Whoever it is, the same jobs give the same episodes, bit for bit on machines of a kind."""

    def run(self, suite: Suite, jobs: Sequence[Job], progress: Progress) -> list[list[Episode]]:
        """The episodes of each job, in the jobs' order and, within one, in that of its seeds."""
        ...

    def close(self) -> None:
        """Let go of what was held. May be called twice."""
        ...


class LocalExecutor:
    """Runs one job after the other in this process, each on several threads."""

    def __init__(self, threads: int | None = None) -> None:
        """Say how many threads step physics; None for one per processor."""
        self._threads = threads

    def run(self, suite: Suite, jobs: Sequence[Job], progress: Progress) -> list[list[Episode]]:
        """See `Executor.run`."""
        results = []
        for job in jobs:
            results.append(run_episodes(suite, job.arena, job.seeds, job.disturbance, threads=self._threads))
            progress(len(job.seeds))
        return results

    def close(self) -> None:
        """See `Executor.close`."""
