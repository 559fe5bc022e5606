"""Results of a regression run: frozen structs that are JSON as they stand, which `--json` writes.

Numbers that do not exist (an error of an episode that failed in its first step) are None, in JSON null.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from humanoid_sim.evaluation.run_report import quantity
from humanoid_sim.regress.suite import Suite

Verdict = Literal["worse beyond tolerance", "worse within tolerance", "better", "no difference seen", "not compared"]
"""Verdict on one metric, the most urgent first: the interval of the worsening lies beyond the tolerance, or excludes 0
and does not, or lies on the other side of 0, or holds 0."""
WORSE: Verdict = "worse beyond tolerance"
"""Verdict that fails a candidate."""
Failure = Literal["", "fault", "lost"]
"""Kind of failure. `fault`: the controller's own refusal (a non-finite or too large action or observation), or a
simulation that became non-finite. `lost`: the robot fell, or strayed too far from what it should follow."""


class Episode(msgspec.Struct, frozen=True, kw_only=True):
    """One rollout of one policy: a case with a seed."""

    case: str
    seed: int
    steps: int
    duration: float  # s of simulated time that the episode lasted
    failure: str = ""
    kind: Failure = ""
    metrics: Mapping[str, float | None]  # by the metric's name, in its unit; None: not measured


class PolicyRun(msgspec.Struct, frozen=True, kw_only=True):
    """One policy over the whole suite."""

    name: str
    source: str
    sha256: str
    case_digests: Mapping[str, str]
    episodes: tuple[Episode, ...]
    versions: Mapping[str, str] = {}  # of the packages that the numbers depend on, and of the platform

    @property
    def failures(self) -> tuple[Episode, ...]:
        return tuple(episode for episode in self.episodes if episode.failure)

    def values(self, metric: str) -> dict[str, dict[int, float]]:
        """Return a metric by case and seed, of the episodes that have it."""
        found: dict[str, dict[int, float]] = {}
        for episode in self.episodes:
            value = episode.metrics.get(metric)
            if value is not None:
                found.setdefault(episode.case, {})[episode.seed] = value
        return found


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """One metric of a candidate against the baseline. Changes are candidate less baseline, in the metric's unit."""

    metric: str
    unit: str
    verdict: Verdict
    candidate: float | None = None  # mean over the episodes that are compared; cases weigh equally
    baseline: float | None = None
    change: float | None = None
    low: float | None = None
    high: float | None = None
    tolerance: float | None = None  # worsening that the suite lets pass, a positive number
    episodes: int = 0  # pairs that are compared; episodes that failed have no errors to compare
    new_failures: tuple[str, ...] = ()
    """Episodes that failed in cases in which none of the baseline's did. One makes the share of failures worse."""

    @property
    def text(self) -> str:
        """Such as `+8.1 mm (+1.5 mm to +13.8 mm)`; empty where nothing was compared."""
        if self.change is None:
            return ""
        change, low, high = (quantity(value, self.unit, signed=True) for value in (self.change, self.low, self.high))
        new = f"; new: {'; '.join(self.new_failures)}" if self.new_failures else ""
        return f"{change} ({low} to {high}){new}"


class Candidate(msgspec.Struct, frozen=True, kw_only=True):
    """One policy under test."""

    run: PolicyRun
    comparisons: tuple[Comparison, ...]

    @property
    def worse(self) -> tuple[str, ...]:
        return tuple(comparison.metric for comparison in self.comparisons if comparison.verdict == WORSE)


class Results(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that one call of `regress` found."""

    suite: Suite
    robot: str
    baseline: PolicyRun | None
    candidates: tuple[Candidate, ...]

    @property
    def passed(self) -> bool:
        """Return whether no metric of any candidate is worse beyond its tolerance."""
        return not any(candidate.worse for candidate in self.candidates)
