"""Is a candidate worse than the baseline? Metric by metric, with an interval for the change and a tolerance.

Episodes are compared pair by pair, so that what a seed does to both cancels. The intervals are by the bootstrap: how
far the mean would move with other episodes of the same cases. Cases are fixed, seeds are a sample: resampling draws
seeds within each case, and the cases' means weigh equally. For few seeds such an interval is too narrow: its spread by
√((n-1)/n) for n seeds, its quantiles because the spread is measured, not known. It is widened by both, the latter by
Student's t with the degrees of freedom of Welch and Satterthwaite (Hesterberg 2015, "What teachers should know about
the bootstrap"). The generator is seeded: the same numbers, the same interval.

A mean hides two things, so both are judged by themselves: a case that is much worse than the others, and a failure of
a kind that its case never had.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.metrics import Metric, failures_of
from humanoid_sim.regress.results import WORSE, Comparison, PolicyRun, Verdict
from humanoid_sim.regress.suite import Suite

_CASE_TOLERANCE = 2.0
"""Tolerance for a single case, in multiples of that for the mean over all of them."""
_CONFIDENCE = 0.95  # that none of a candidate's intervals misses its change
_RESAMPLES, _SEED = 10_000, 2026
_ROUNDING = 1e-9  # in any unit: machines of a kind may differ in the last bits
_MOST_FREEDOM = 1e4
_ANGLES = np.linspace(0.0, 0.5 * np.pi, 20_001)  # that `student_quantile` integrates over


def compare_runs(suite: Suite, baseline: PolicyRun, run: PolicyRun) -> tuple[Comparison, ...]:
    """Return every metric that the suite judges of a run against the baseline's."""
    return tuple(_compare(suite, metric, baseline, run) for metric in suite.metrics)


def _compare(suite: Suite, metric: Metric, baseline: PolicyRun, run: PolicyRun) -> Comparison:
    name, is_failure = metric.name, metric.name in failures_of(suite.task)
    confidence = 1.0 - (1.0 - _CONFIDENCE) / len(suite.metrics)  # Bonferroni: more metrics raise no more alarms
    old, new = baseline.values(name), run.values(name)
    seeds = {case: sorted(old[case].keys() & new[case].keys()) for case in sorted(old.keys() & new.keys())}
    was, now = (
        {case: np.array([values[case][seed] for seed in of_case]) for case, of_case in seeds.items() if of_case}
        for values in (old, new)
    )
    if not was:
        verdict: Verdict = WORSE if old and not new else "no difference seen"
        return Comparison(metric=name, unit=metric.unit, verdict=verdict, episodes=0)
    mean, tolerance = _mean([*was.values()]), suite.tolerance(name, _mean([*was.values()]))
    never_failed = {case for case, values in old.items() if not any(values.values())}
    if is_failure and len(never_failed) == len(old):
        tolerance = 0.0  # where the baseline has no failure, one is enough
    new_failures = [e.label for e in run.episodes if is_failure and e.case in never_failed and e.metrics.get(name)]
    differences = {case: now[case] - was[case] for case in was if is_failure or len(was[case]) > 1}
    worse_cases = {}
    for case in () if is_failure else differences:
        alone = mean_interval([differences[case]], confidence)
        if _verdict(metric, alone, _CASE_TOLERANCE * suite.tolerance(name, float(was[case].mean()))) == WORSE:
            worse_cases[case] = alone.mean
    change = mean_interval([now[case] - was[case] for case in was], confidence)
    verdict = _verdict(metric, change, tolerance) if differences else "no difference seen"  # one value has no spread
    return Comparison(
        metric=name,
        unit=metric.unit,
        verdict=WORSE if new_failures or worse_cases else verdict,
        baseline=mean,
        candidate=_mean([*now.values()]),
        change=change.mean,
        low=change.low,
        high=change.high,
        tolerance=tolerance,
        episodes=sum(map(len, now.values())),
        worse_cases=worse_cases,
        new_failures=tuple(new_failures),
    )


def _verdict(metric: Metric, change: Interval, tolerance: float) -> Verdict:
    low, high = (change.low, change.high) if metric.better == "lower" else (-change.high, -change.low)
    if max(-low, high) < _ROUNDING:
        return "no difference seen"
    if low > tolerance:
        return WORSE
    if low > 0.0:
        return "worse within tolerance"
    return "better" if high < 0.0 else "no difference seen"


def _mean(cases: Sequence[FloatArray]) -> float:
    return float(np.mean([case.mean() for case in cases]))


class Interval(NamedTuple):
    """A mean with its confidence interval."""

    mean: float
    low: float
    high: float


def mean_interval(cases: Sequence[FloatArray], confidence: float) -> Interval:
    """Return the mean over cases, each a value per seed, with its percentile interval; the confidence is two-sided."""
    generator = np.random.default_rng(_SEED)
    spread = np.zeros(_RESAMPLES)
    variances: list[float] = []
    freedom: list[int] = []
    for values in cases:
        n = len(values)
        if n > 1:  # means of draws with replacement, less the mean of the values
            drawn = values[generator.integers(n, size=(_RESAMPLES, n))]
            spread += (drawn.mean(axis=1) - values.mean()) * math.sqrt(n / (n - 1)) / len(cases)
            variances.append(float(values.var(ddof=1)) / n / len(cases) ** 2)
            freedom.append(n - 1)
    mean, tail = _mean(cases), 0.5 * (1.0 - confidence)
    quantile = student_quantile(1.0 - tail, variances, freedom)
    low, high = np.quantile(spread, [tail, 1.0 - tail]) * (quantile / NormalDist().inv_cdf(1.0 - tail))
    return Interval(mean, mean + float(low), mean + float(high))


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
