"""What a regression run found: frozen structs that are JSON as they stand.

`Results` is what `--json` prints and what the report is made from; one `PolicyRun` alone is a baseline file. Numbers
that do not exist (an error of an episode that failed in its first step) are None, in JSON null.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import msgspec

__all__ = [
    "Candidate",
    "Comparison",
    "Detectable",
    "Episode",
    "Margin",
    "MarginComparison",
    "MetricInfo",
    "PolicyRun",
    "Results",
    "SuiteInfo",
    "Verdict",
    "describe_change",
    "describe_detectable",
    "describe_margin",
    "displayed_unit",
    "quantity",
]

Verdict = Literal["worse", "better", "same", "unclear", "unmeasured"]
"""Of one metric: `worse` and `better` are shown to be beyond the tolerance, `same` to be within it; `unclear` is
neither (too few episodes), and `unmeasured` has no episodes that could be compared."""


class MetricInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a metric means."""

    name: str
    """Such as `body_position_error`."""
    unit: str
    """Such as `m`; `share` for a share of the episodes, between 0 and 1."""
    better: Literal["lower", "higher"]
    summary: str
    """One sentence for a person."""


class SuiteInfo(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which suite was run, and how much of it."""

    name: str
    summary: str
    task: Literal["tracking", "velocity"]
    robot: str
    cases: tuple[str, ...]
    """Names of the motions or commands, in the suite's order."""
    seeds: tuple[int, ...]
    """Each case is run once with each of them."""
    duration: float
    """s, of the longest episode."""
    policy_dt: float
    """s between two values of a trace, before it is thinned out."""


class Episode(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One rollout of one policy: a case with a seed."""

    case: str
    seed: int
    steps: int
    """Policy steps until the end, or until the failure."""
    duration: float
    """s of simulated time that the episode lasted."""
    failure: str = ""
    """Why the episode failed, in one line; empty: it did not."""
    kind: Literal["", "fault", "lost"] = ""
    """Of the failure. `fault`: the controller's own refusal (a non-finite or too large action or observation), or a
    simulation that became non-finite. `lost`: the robot fell, or strayed too far from what it should follow."""
    metrics: Mapping[str, float | None]
    """By the metric's name, in its unit; None: not measured."""
    trace_times: tuple[float, ...] = ()
    """s since the start of the episode, K of them, at most 128: the middle of the steps that a value is the mean of."""
    traces: Mapping[str, tuple[float | None, ...]] = {}
    """By the trace's name, K values each: the metrics that exist step by step under their own names (`joint_error`,
    `velocity_error`, …), in their units."""

    @property
    def label(self) -> str:
        """Such as `wave, seed 3`."""
        return f"{self.case}, seed {self.seed}"


class Margin(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How much of one disturbance a policy bears."""

    axis: str
    """Such as `delay`."""
    unit: str
    """Such as `ms`."""
    nominal: float
    """The value without the disturbance."""
    limit: float
    """The largest value, in the direction away from nominal, at which it passed at every level up to it."""
    reached_end: bool
    """It never failed: the margin is at least `limit`, the end of what the suite sweeps."""
    failure: str = ""
    """Why it failed just beyond the limit; empty where it did not."""
    levels: tuple[float, ...] = ()
    """The values that were tried, nearest to nominal first."""
    failed_share: tuple[float, ...] = ()
    """At each level the share of the episodes that failed, or missed the suite's limit."""


class PolicyRun(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One policy over the whole suite. Written to a file it is a baseline."""

    format: Literal["humanoid_sim.regress/1"] = "humanoid_sim.regress/1"
    name: str
    """What to call the policy: unique within a run."""
    source: str
    """The file that it came from."""
    sha256: str
    """Of that file."""
    suite: str
    """The suite's name."""
    case_digests: Mapping[str, str]
    """By case the SHA-256 of all that its episodes depend on beside policy and seed: only equals are compared."""
    episodes: tuple[Episode, ...]
    """Case by case in the suite's order, within a case seed by seed."""
    margins: tuple[Margin, ...] = ()
    """Empty without `--margins`."""
    definitions: Mapping[str, str] = {}
    """What its figures mean, as `humanoid_sim.evaluation.definitions` had it: only equals are compared."""
    batching: str = ""
    """How inference was batched: `in batches`, or `row by row: …` and why not."""
    versions: Mapping[str, str] = {}
    """Of the packages that the numbers depend on, and of the platform."""

    @property
    def failures(self) -> tuple[Episode, ...]:
        """The episodes that failed."""
        return tuple(episode for episode in self.episodes if episode.failure)


class Detectable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How small a worsening the suite can detect: said before the candidate has run, from the baseline alone."""

    metric: str
    baseline: float
    """Mean over the baseline's episodes."""
    tolerance: float
    """The worsening that the suite lets pass, in the metric's unit."""
    change: float
    """The worsening that is found with a probability of `power`, tolerance included, in the metric's unit."""
    power: float


class Comparison(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One metric of a candidate against the baseline. Changes are candidate less baseline, in the metric's unit."""

    metric: str
    verdict: Verdict
    baseline: float | None
    """Mean over the episodes that are compared; cases weigh equally."""
    candidate: float | None
    change: float | None
    low: float | None
    """Lower end of the confidence interval of the change."""
    high: float | None
    tolerance: float | None
    """The worsening that the suite lets pass, a positive number."""
    episodes: int
    """Pairs that are compared, or, unpaired, the candidate's episodes."""
    paired: bool
    """By case and seed; where the baseline was run with other seeds, the two are compared case by case instead."""

    @property
    def is_lost(self) -> bool:
        """The baseline has it, and no episode of the candidate has."""
        return self.verdict == "unmeasured" and self.baseline is not None and self.candidate is None

    @property
    def relative(self) -> float | None:
        """Change as a share of the baseline; None where that is 0 or unknown."""
        if self.change is None or not self.baseline:
            return None
        return self.change / abs(self.baseline)


class MarginComparison(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A margin beside the baseline's."""

    axis: str
    baseline: float
    candidate: float
    verdict: Literal["worse", "better", "same"]
    """One level of the sweep more or less is within what the seeds can tell, and counts as the same."""


class Candidate(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One policy under test."""

    run: PolicyRun
    passed: bool
    """No metric and no margin is worse, and no metric is lost."""
    comparisons: tuple[Comparison, ...] = ()
    """Empty without a baseline."""
    margins: tuple[MarginComparison, ...] = ()

    @property
    def worse(self) -> tuple[str, ...]:
        """Names of the metrics that are worse or lost and, with the prefix `margin `, of the margins that are worse."""
        metrics = [c.metric for c in self.comparisons if c.verdict == "worse" or c.is_lost]
        return (*metrics, *(f"margin {margin.axis}" for margin in self.margins if margin.verdict == "worse"))


class Results(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Everything that one call of `regress` found."""

    suite: SuiteInfo
    metrics: tuple[MetricInfo, ...]
    """In the order in which they are shown; the first is the one that episodes are ranked by."""
    confidence: float
    """That none of a candidate's intervals misses its change, such as 0.95: it is shared among the metrics."""
    resamples: int
    """Of the bootstrap."""
    baseline: PolicyRun | None
    detectable: tuple[Detectable, ...]
    """Empty without a baseline."""
    candidates: tuple[Candidate, ...]

    @property
    def passed(self) -> bool:
        """Whether every candidate passed."""
        return all(candidate.passed for candidate in self.candidates)

    def metric(self, name: str) -> MetricInfo:
        """The metric of that name; KeyError if there is none."""
        return {metric.name: metric for metric in self.metrics}[name]


def displayed_unit(unit: str) -> tuple[float, str]:
    """What to multiply a value by, and the unit that it then has: lengths in mm, angles in degrees, shares in %."""
    return {
        "m": (1e3, "mm"),
        "rad": (180.0 / math.pi, "°"),
        "rad/s": (180.0 / math.pi, "°/s"),
        "s": (1e3, "ms"),
        "share": (100.0, "%"),
    }.get(unit, (1.0, unit))


def quantity(value: float | None, unit: str, *, signed: bool = False) -> str:
    """A value with the unit that a person reads it in, such as `12.1 mm`; `-` where there is none."""
    if value is None or math.isnan(value):
        return "-"
    factor, shown = displayed_unit(unit)
    gap = "" if shown in ("°", "×") else " "
    return f"{factor * value:{'+' if signed else ''}.3g}{gap}{shown}"


def describe_change(metric: MetricInfo, comparison: Comparison) -> str:
    """Such as `12.1 mm, was 10.3 mm: +1.8 mm (+17.5 %), between +1.5 and +2.1 mm; tolerated: 0.515 mm`."""
    unit = metric.unit
    if comparison.change is None:
        return f"{quantity(comparison.candidate, unit)}, was {quantity(comparison.baseline, unit)}"
    relative = "" if comparison.relative is None else f" ({100.0 * comparison.relative:+.1f} %)"
    return (
        f"{quantity(comparison.candidate, unit)}, was {quantity(comparison.baseline, unit)}: "
        f"{quantity(comparison.change, unit, signed=True)}{relative}, between "
        f"{quantity(comparison.low, unit, signed=True)} and {quantity(comparison.high, unit, signed=True)}; "
        f"tolerated: {quantity(comparison.tolerance, unit)}"
    )


def describe_detectable(metric: MetricInfo, detectable: Detectable) -> str:
    """Such as `+0.9 mm (8.7 %)`: the worsening that the suite finds."""
    if metric.unit == "share" and detectable.change > 1.0:
        return "too few episodes"  # not even if all of them failed
    sign = 1.0 if metric.better == "lower" else -1.0
    relative = f" ({100.0 * detectable.change / abs(detectable.baseline):.1f} %)" if detectable.baseline else ""
    return f"{quantity(sign * detectable.change, metric.unit, signed=True)}{relative}"


def describe_margin(margin: MarginComparison) -> str:
    """Such as `0.02, was 0.03`."""
    return f"{margin.candidate:g}, was {margin.baseline:g}"
