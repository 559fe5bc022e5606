"""Is a candidate worse than the baseline? Metric by metric, with an interval for the change and a tolerance.

The intervals are by the bootstrap: how far the mean would move with other episodes of the same cases. Cases are fixed,
seeds are a sample: resampling draws seeds within each case, and the cases' means weigh equally. For few seeds such an
interval is too narrow: its spread by √((n-1)/n) for n seeds, its quantiles because the spread is measured, not known.
It is widened by both, the latter by Student's t with the degrees of freedom of Welch and Satterthwaite (Hesterberg
2015, "What teachers should know about the bootstrap"). The generator is seeded: the same numbers, the same interval.

A mean hides two things, so both are judged by themselves: a case that is much worse than the others, and a failure of
a kind that its case never had.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.metrics import ALWAYS, has_metric
from humanoid_sim.regress.results import (
    FAILING,
    Candidate,
    CaseComparison,
    Comparison,
    MetricInfo,
    PolicyRun,
    Verdict,
)
from humanoid_sim.regress.suite import Suite

FEW_SEEDS = 6
"""With fewer seeds of each case, their spread is hardly known, and a warning says so."""
CASE_TOLERANCE = 2.0
"""Tolerance for a single case, in multiples of that for the mean over all of them."""
_SEED = 2026
_MOST_FREEDOM = 1e4
_ANGLES = np.linspace(0.0, 0.5 * np.pi, 20_001)
"""Angles that `student_quantile` integrates over."""


def judge(suite: Suite, baseline: PolicyRun | None, run: PolicyRun, *, strict: bool = False) -> Candidate:
    """Return the verdicts on a run; an open one fails it with `strict`, or with too few seeds to judge."""
    if baseline is None:
        return Candidate(run=run, passed=True)
    comparisons = compare_runs(suite, suite.metrics, baseline, run)
    few = min(fewest_seeds(baseline), fewest_seeds(run))
    candidate = Candidate(run=run, passed=False, comparisons=comparisons, few_seeds=few if few < FEW_SEEDS else None)
    return replace(
        candidate, passed=not candidate.worse and not candidate.undecided and not (strict and candidate.unclear)
    )


def fewest_seeds(run: PolicyRun) -> int:
    """Return the number of seeds of the case that was run with the fewest; 0 without any episode."""
    return min(Counter(episode.case for episode in run.episodes).values(), default=0)


def compare_runs(
    suite: Suite, metrics: Sequence[MetricInfo], baseline: PolicyRun, run: PolicyRun
) -> tuple[Comparison, ...]:
    """Return every metric of a run against the baseline's, in the order of `metrics`.

    Runs over the same seeds, or of which one has all those of the other, are compared pair by pair, so that what a seed
    does to both cancels; runs over other seeds case by case. The confidence of the suite is that of all metrics'
    intervals together (Bonferroni), so that a suite does not raise more false alarms for having more metrics.
    """
    before, after = ({(e.case, e.seed) for e in r.episodes} for r in (baseline, run))
    paired = before <= after or after <= before
    confidence = 1.0 - (1.0 - suite.confidence) / max(len(metrics), 1)
    return tuple(_compare(suite, confidence, metric, baseline, run, paired) for metric in metrics)


def _compare(
    suite: Suite, confidence: float, metric: MetricInfo, baseline: PolicyRun, run: PolicyRun, paired: bool
) -> Comparison:
    """Compare one metric."""
    name, is_failure = metric.name, metric.name in ALWAYS[suite.task]
    old, new = _values(name, baseline), _values(name, run)
    both = {case: (old[case].keys() & new[case].keys() if paired else None) for case in sorted(old) if case in new}
    was, now = ({case: _array(v[case], kept) for case, kept in both.items() if kept != set()} for v in (old, new))
    comparison = Comparison(
        metric=name,
        verdict="lost" if old and not new else "unmeasured",
        baseline=mean_of_cases([*was.values()] or [_array(values) for values in old.values()]) if old else None,
        candidate=mean_of_cases([*now.values()] or [_array(values) for values in new.values()]) if new else None,
        episodes=sum(map(len, now.values())),
        paired=paired,
        left_out=_left_out(suite, name, baseline, run, paired),
    )
    if not was:
        return comparison

    def change_in(cases: Sequence[str]) -> Interval:
        if paired:
            return mean_interval([now[case] - was[case] for case in cases], [], confidence, suite.resamples)
        return mean_interval([now[case] for case in cases], [was[case] for case in cases], confidence, suite.resamples)

    change = change_in([*was])
    never_failed = {case for case, values in old.items() if not any(values.values())}
    tolerance = suite.tolerance(name, mean_of_cases([*was.values()]))
    if is_failure and len(never_failed) == len(old):
        tolerance = 0.0  # where the baseline has no failure, one is enough
    new_failures = [e.label for e in run.episodes if is_failure and e.case in never_failed and e.metrics.get(name)]
    cases = []
    for case in () if is_failure else was:
        if len(was[case]) > 1 and len(now[case]) > 1:
            before, after, alone = float(was[case].mean()), float(now[case].mean()), change_in([case])
            verdict = _verdict(metric, alone, CASE_TOLERANCE * suite.tolerance(name, before))
            cases.append(
                CaseComparison(case=case, verdict=verdict, baseline=before, candidate=after, change=alone.mean)
            )
    verdict = _verdict(metric, change, tolerance) if cases or is_failure else "unclear"  # one value has no spread
    is_worse = bool(new_failures) or any(case.verdict in FAILING for case in cases)
    return replace(
        comparison,
        verdict="worse beyond tolerance" if is_worse else verdict,
        change=change.mean,
        low=change.low,
        high=change.high,
        tolerance=tolerance,
        cases=tuple(cases),
        new_failures=tuple(new_failures),
    )


def _left_out(suite: Suite, metric: str, baseline: PolicyRun, run: PolicyRun, paired: bool) -> int:
    """Return how many pairs, or unpaired episodes of both, have no value because an episode failed."""
    cases = {case.name for case in suite.cases if has_metric(metric, case.command)}
    missing = [
        {(e.case, e.seed) for e in r.failures if e.metrics.get(metric) is None and e.case in cases}
        for r in (baseline, run)
    ]
    if not paired:
        return len(missing[0]) + len(missing[1])
    shared = {(e.case, e.seed) for e in baseline.episodes} & {(e.case, e.seed) for e in run.episodes}
    return len((missing[0] | missing[1]) & shared)


def _verdict(metric: MetricInfo, change: Interval, tolerance: float) -> Verdict:
    """Judge by where the interval of the worsening lies."""
    low, high = (change.low, change.high) if metric.better == "lower" else (-change.high, -change.low)
    if low > tolerance:
        return "worse beyond tolerance"
    if low > 0.0:
        return "worse within tolerance" if high <= tolerance else "worse, perhaps beyond tolerance"
    if high < 0.0:
        return "better"
    return "no difference seen" if high <= tolerance else "unclear"


def _values(metric: str, run: PolicyRun) -> dict[str, dict[int, float]]:
    """By case and seed, of the episodes that have the metric."""
    found: dict[str, dict[int, float]] = {}
    for episode in run.episodes:
        value = episode.metrics.get(metric)
        if value is not None:
            found.setdefault(episode.case, {})[episode.seed] = value
    return found


def _array(values: Mapping[int, float], kept: Set[int] | None = None) -> FloatArray:
    """Those of some seeds, or all, in the seeds' order."""
    return np.array([values[seed] for seed in sorted(values.keys() if kept is None else kept)])


def mean_of_cases(cases: Sequence[FloatArray]) -> float:
    """Return the mean over cases of each case's mean; NaN without any."""
    return float(np.mean([case.mean() for case in cases])) if cases else math.nan


def student_quantile(probability: float, variances: Sequence[float], freedom: Sequence[int]) -> float:
    """Return the quantile, above the median, of Student's t for a sum of variances with their degrees of freedom.

    With t = √ν tan α the density is proportional to cos(α)^(ν-1). ν is Satterthwaite's: (Σ v)² / Σ (v² / ν). Without
    any variance it is the normal distribution's.
    """
    squares = sum(v * v / n for v, n in zip(variances, freedom, strict=True) if v > 0.0)
    if not squares:
        return NormalDist().inv_cdf(probability)
    total = min(sum(variances) ** 2 / squares, _MOST_FREEDOM)
    density = np.cos(_ANGLES) ** (total - 1.0)
    area = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
    return math.sqrt(total) * math.tan(float(np.interp(2.0 * probability - 1.0, area / area[-1], _ANGLES)))


class Interval(NamedTuple):
    """A mean and where it lies with some confidence."""

    mean: float
    low: float
    high: float


def mean_interval(
    plus: Sequence[FloatArray], minus: Sequence[FloatArray], confidence: float, resamples: int
) -> Interval:
    """Return the mean over cases of `plus`, less that of `minus`, with its percentile interval.

    Args:
        plus: one array per case, a value per seed; for paired comparisons the differences.
        minus: one array per case, sampled independently of `plus`; empty for nothing to subtract.
        confidence: two-sided, such as 0.95.
    """
    generator = np.random.default_rng(_SEED)
    spread = np.zeros(resamples)
    variances: list[float] = []
    freedom: list[int] = []
    for sign, samples in ((1.0, plus), (-1.0, minus)):
        for values in samples:
            n = len(values)
            if n > 1:  # means of draws with replacement, less the mean of the values
                drawn = values[generator.integers(n, size=(resamples, n))]
                deviation = (drawn.mean(axis=1) - values.mean()) * math.sqrt(n / (n - 1))
                spread += sign * deviation / len(samples)
                variances.append(float(values.var(ddof=1)) / n / len(samples) ** 2)
                freedom.append(n - 1)
    mean = mean_of_cases(plus) - (mean_of_cases(minus) if minus else 0.0)
    tail = 0.5 * (1.0 - confidence)
    quantile = student_quantile(1.0 - tail, variances, freedom)
    low, high = np.quantile(spread, [tail, 1.0 - tail]) * (quantile / NormalDist().inv_cdf(1.0 - tail))
    return Interval(mean, mean + float(low), mean + float(high))
