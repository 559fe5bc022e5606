"""Is a candidate worse than the baseline? Metric by metric, with an interval for the change and a tolerance.

The intervals are by the bootstrap: how far the mean would move with other episodes of the same cases. Cases are fixed,
seeds are a sample: resampling draws seeds within each case, and the cases' means weigh equally. The spread of a
resampled mean is too narrow by √((n-1)/n) for n seeds, and is widened by that (Hesterberg 2015, "What teachers should
know about the bootstrap"). The same numbers give the same interval: the generator is seeded.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from statistics import NormalDist

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.results import (
    Candidate,
    Comparison,
    Detectable,
    Margin,
    MarginComparison,
    MetricInfo,
    PolicyRun,
    Verdict,
)
from humanoid_sim.regress.suite import AXES, Suite

__all__ = [
    "POWER",
    "Interval",
    "compare_margins",
    "compare_runs",
    "detectable_changes",
    "difference_error",
    "judge",
    "mean_interval",
    "mean_of_cases",
]

POWER = 0.8
"""Probability with which a change of the size that is announced is found."""
_SEED = 2026


def judge(suite: Suite, baseline: PolicyRun | None, run: PolicyRun) -> Candidate:
    """The verdicts on a run."""
    if baseline is None:
        return Candidate(run=run, passed=True)
    comparisons = compare_runs(suite, suite.metrics, baseline, run)
    margins = compare_margins(suite, baseline.margins, run.margins) if run.margins else ()
    is_worse = any(comparison.verdict == "worse" or comparison.is_lost for comparison in comparisons)
    passed = not is_worse and all(margin.verdict != "worse" for margin in margins)
    return Candidate(run=run, passed=passed, comparisons=comparisons, margins=margins)


def compare_runs(
    suite: Suite, metrics: Sequence[MetricInfo], baseline: PolicyRun, run: PolicyRun
) -> tuple[Comparison, ...]:
    """Every metric of a run against the baseline's, in the order of `metrics`.

    Runs over the same seeds, or of which one has all those of the other, are compared pair by pair, so that what a seed
    does to both cancels; runs over other seeds case by case. The confidence of the suite is that of all intervals
    together (Bonferroni), so that a suite does not raise more false alarms for having more metrics.
    """
    before, after = ({(e.case, e.seed) for e in r.episodes} for r in (baseline, run))
    paired = before <= after or after <= before
    return tuple(_compare(suite, len(metrics), metric, baseline, run, paired) for metric in metrics)


def _compare(
    suite: Suite, count: int, metric: MetricInfo, baseline: PolicyRun, run: PolicyRun, paired: bool
) -> Comparison:
    """One of `count` metrics."""
    before, after = _values(metric.name, baseline), _values(metric.name, run)
    cases = {case for case, _ in before} & {case for case, _ in after}
    kept = before.keys() & after.keys() if paired else {key for key in before.keys() | after.keys() if key[0] in cases}
    was, now = _by_case(before, kept), _by_case(after, kept)
    if not was or not now:
        return Comparison(
            metric=metric.name,
            verdict="unmeasured",
            baseline=mean_of_cases(_by_case(before, before.keys())) if before else None,
            candidate=mean_of_cases(_by_case(after, after.keys())) if after else None,
            change=None,
            low=None,
            high=None,
            tolerance=None,
            episodes=0,
            paired=paired,
        )
    plus, minus = ([b - a for a, b in zip(was, now, strict=True)], []) if paired else (now, was)
    interval = mean_interval(plus, minus, 1.0 - (1.0 - suite.confidence) / count, suite.resamples)
    tolerance = suite.tolerance(metric.name, mean_of_cases(was))
    low, high = (interval.low, interval.high) if metric.better == "lower" else (-interval.high, -interval.low)
    verdict: Verdict = "same" if high <= tolerance else "unclear"
    if low > tolerance:
        verdict = "worse"
    elif high < -tolerance:
        verdict = "better"
    return Comparison(
        metric=metric.name,
        verdict=verdict,
        baseline=mean_of_cases(was),
        candidate=mean_of_cases(now),
        change=interval.mean,
        low=interval.low,
        high=interval.high,
        tolerance=tolerance,
        episodes=sum(len(values) for values in now),
        paired=paired,
    )


def _values(metric: str, run: PolicyRun) -> dict[tuple[str, int], float]:
    """By case and seed, of the episodes that have the metric."""
    values = {(episode.case, episode.seed): episode.metrics.get(metric) for episode in run.episodes}
    return {key: value for key, value in values.items() if value is not None}


def _by_case(values: Mapping[tuple[str, int], float], kept: Set[tuple[str, int]]) -> list[FloatArray]:
    """The values to be kept, one array per case, both in a fixed order."""
    groups = groupby(sorted(values.keys() & kept), key=itemgetter(0))
    return [np.array([values[key] for key in keys]) for _, keys in groups]


def detectable_changes(suite: Suite, metrics: Sequence[MetricInfo], baseline: PolicyRun) -> tuple[Detectable, ...]:
    """How small a worsening the suite finds with a probability of `POWER`: the tolerance and (z + z') standard errors.

    From the baseline and the suite's number of seeds alone, as if the candidate were run with other seeds: comparing
    pair by pair can only make it smaller. A metric that no episode of the baseline has is left out.
    """
    quantile = NormalDist().inv_cdf
    confidence = 1.0 - (1.0 - suite.confidence) / max(len(metrics), 1)
    factor = quantile(0.5 + 0.5 * confidence) + quantile(POWER)
    found = []
    for metric in metrics:
        values = _values(metric.name, baseline)
        cases = _by_case(values, values.keys())
        if not cases:
            continue
        mean = mean_of_cases(cases)
        tolerance = suite.tolerance(metric.name, mean)
        error = difference_error(cases, suite.seeds)
        if metric.unit == "share":
            # None failing of n does not mean that none ever would: Laplace's rule, (k + 1) / (n + 2).
            share = (sum(values.values()) + 1.0) / (len(values) + 2.0)
            error = math.sqrt(share * (1.0 - share) * (1.0 / len(values) + 1.0 / (suite.seeds * len(cases))))
        change = tolerance + factor * error
        found.append(Detectable(metric=metric.name, baseline=mean, tolerance=tolerance, change=change, power=POWER))
    return tuple(found)


def difference_error(cases: Sequence[FloatArray], count: int) -> float:
    """Standard error of the difference to be expected between these samples' mean and that of `count` new seeds a case.

    From the spread of the seeds within each case, which the new ones are taken to share; a case with one seed adds
    nothing.
    """
    variances = [values.var(ddof=1) * (1.0 / len(values) + 1.0 / count) for values in cases if len(values) > 1]
    return math.sqrt(sum(variances)) / len(cases) if cases else math.nan


def mean_of_cases(cases: Sequence[FloatArray]) -> float:
    """The mean over cases of each case's mean; NaN without any."""
    return float(np.mean([case.mean() for case in cases])) if cases else math.nan


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and where it lies with some confidence."""

    mean: float
    low: float
    high: float


def mean_interval(
    plus: Sequence[FloatArray], minus: Sequence[FloatArray], confidence: float, resamples: int
) -> Interval:
    """The mean over cases of `plus`, less that of `minus`, with its percentile interval.

    Args:
        plus: one array per case, a value per seed; for paired comparisons the differences.
        minus: one array per case, sampled independently of `plus`; empty for nothing to subtract.
        confidence: two-sided, such as 0.95.
        resamples: of the bootstrap.
    """
    generator = np.random.default_rng(_SEED)
    spread = np.zeros(resamples)
    for sign, samples in ((1.0, plus), (-1.0, minus)):
        for values in samples:
            n = len(values)
            if n > 1:  # means of draws with replacement, less the mean of the values
                drawn = values[generator.integers(n, size=(resamples, n))]
                deviation = (drawn.mean(axis=1) - values.mean()) * math.sqrt(n / (n - 1))
                spread += sign * deviation / len(samples)
    mean = mean_of_cases(plus) - (mean_of_cases(minus) if minus else 0.0)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(spread, [tail, 1.0 - tail])
    return Interval(mean, mean + float(low), mean + float(high))


def compare_margins(suite: Suite, before: Sequence[Margin], after: Sequence[Margin]) -> tuple[MarginComparison, ...]:
    """The margins that both have, in the suite's order.

    One level of the sweep more or less is within what a few seeds can tell, and counts as the same.
    """
    if suite.margins is None:
        return ()
    old, new = ({margin.axis: margin for margin in margins} for margins in (before, after))
    found = []
    for sweep in suite.margins.sweeps:
        if sweep.name in old and sweep.name in new:
            levels = [AXES[sweep.axis][1], *sweep.levels]
            baseline, candidate = old[sweep.name].limit, new[sweep.name].limit
            steps = _place(levels, candidate) - _place(levels, baseline)
            verdict = "worse" if steps < -1 else "better" if steps > 1 else "same"
            found.append(
                MarginComparison(axis=sweep.name, baseline=baseline, candidate=candidate, verdict=verdict)  # type: ignore[arg-type]
            )
    return tuple(found)


def _place(levels: Sequence[float], limit: float) -> int:
    """The level that a limit is, or is nearest to: a stored baseline's sweep may have had others."""
    return min(range(len(levels)), key=lambda i: abs(levels[i] - limit))
