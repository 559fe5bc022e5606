"""Results of a regression run: frozen structs that are JSON as they stand.

`Results` is what `--json` writes and what the report is made from; one `PolicyRun` alone is a baseline file. Numbers
that do not exist (an error of an episode that failed in its first step) are None, in JSON null.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import msgspec

from humanoid_sim.regress.suite import Suite

Verdict = Literal["worse beyond tolerance", "worse within tolerance", "better", "no difference seen"]
"""Verdict on one metric, the most urgent first: the interval of the worsening lies beyond the tolerance, or excludes 0
and does not, or lies on the other side of 0, or holds 0."""
WORSE: Verdict = "worse beyond tolerance"
"""Verdict that fails a candidate."""


class Episode(msgspec.Struct, frozen=True, kw_only=True):
    """One rollout of one policy: a case with a seed."""

    case: str
    seed: int
    steps: int
    duration: float
    """s of simulated time that the episode lasted."""
    failure: str = ""
    kind: Literal["", "fault", "lost"] = ""
    """Kind of failure. `fault`: the controller's own refusal (a non-finite or too large action or observation), or a
    simulation that became non-finite. `lost`: the robot fell, or strayed too far from what it should follow."""
    metrics: Mapping[str, float | None]
    """By the metric's name, in its unit; None: not measured."""

    @property
    def label(self) -> str:
        """Such as `wave, seed 3`."""
        return f"{self.case}, seed {self.seed}"


class PolicyRun(msgspec.Struct, frozen=True, kw_only=True):
    """One policy over the whole suite. Written to a file it is a baseline; other fields of a file are ignored."""

    format: Literal["humanoid_sim.regress/1"] = "humanoid_sim.regress/1"
    name: str
    source: str
    sha256: str
    suite: str
    case_digests: Mapping[str, str]
    episodes: tuple[Episode, ...]
    versions: Mapping[str, str] = {}
    """Versions of the packages that the numbers depend on, and of the platform."""

    @property
    def failures(self) -> tuple[Episode, ...]:
        """The episodes that failed."""
        return tuple(episode for episode in self.episodes if episode.failure)

    def values(self, metric: str) -> dict[str, dict[int, float]]:
        """Return a metric by case and seed, of the episodes that have it."""
        found: dict[str, dict[int, float]] = {}
        for episode in self.episodes:
            value = episode.metrics.get(metric)
            if value is not None:
                found.setdefault(episode.case, {})[episode.seed] = value
        return found


class Comparison(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One metric of a candidate against the baseline. Changes are candidate less baseline, in the metric's unit."""

    metric: str
    unit: str
    verdict: Verdict
    baseline: float | None = None
    """Mean over the pairs that are compared; cases weigh equally. None where no pair has the metric."""
    candidate: float | None = None
    change: float | None = None
    low: float | None = None
    high: float | None = None
    tolerance: float | None = None
    """The worsening that the suite lets pass, a positive number."""
    episodes: int
    """Pairs that are compared; episodes that failed have no errors to compare."""
    worse_cases: Mapping[str, float] = {}
    """Change in each case that is worse beyond tolerance by itself. One makes the metric worse."""
    new_failures: tuple[str, ...] = ()
    """Episodes that failed in cases in which none of the baseline's did. One makes the share of failures worse."""

    @property
    def text(self) -> str:
        """Such as `+8.1 % (+1.5 to +13.8 %), tolerated 10 %`, and what makes it worse whatever its mean is."""
        if self.change is None:
            return "no episode has it" if self.verdict == WORSE else "nothing to compare"
        change, low, high = (self._share(value) for value in (self.change, self.low, self.high))
        text = f"{change} ({low.removesuffix(' %')} to {high})"
        if self.verdict.startswith("worse"):
            text += f", tolerated {self._share(self.tolerance).removeprefix('+')}"
        text += "".join(f"; {case} {quantity(by, self.unit, signed=True)}" for case, by in self.worse_cases.items())
        if self.new_failures:
            text += f"; {len(self.new_failures)} new, such as {self.new_failures[0]}"
        return text

    def _share(self, value: float | None) -> str:
        """Return a change such as `+8.0 %` of the baseline, and where it has no such share, the value itself."""
        if value is None or not self.baseline or self.unit == "share":
            return quantity(value, self.unit, signed=True)
        return f"{100.0 * value / abs(self.baseline):+.1f} %"


class Candidate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One policy under test."""

    run: PolicyRun
    comparisons: tuple[Comparison, ...] = ()

    @property
    def worse(self) -> tuple[str, ...]:
        """Names of the metrics that fail the candidate."""
        return tuple(comparison.metric for comparison in self.comparisons if comparison.verdict == WORSE)

    @property
    def passed(self) -> bool:
        """Return whether no metric is worse beyond its tolerance."""
        return not self.worse


class Results(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that one call of `regress` found."""

    suite: Suite
    robot: str
    baseline: PolicyRun | None
    candidates: tuple[Candidate, ...]

    @property
    def passed(self) -> bool:
        """Return whether every candidate passed."""
        return all(candidate.passed for candidate in self.candidates)


_SHOWN = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "°"), "rad/s": (180.0 / math.pi, "°/s"), "share": (100.0, "%")}
"""By unit what to multiply a value by for a person, and the unit that it then has."""


def quantity(value: float | None, unit: str, *, signed: bool = False) -> str:
    """Return a value with the unit that a person reads it in, such as `12.1 mm`; `-` where there is none."""
    if value is None:
        return "-"
    factor, shown = _SHOWN.get(unit, (1.0, unit))
    gap = "" if shown in ("°", "×") else " "
    return f"{factor * value:{'+' if signed else ''}.3g}{gap}{shown}"
