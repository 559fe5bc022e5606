"""Is a candidate worse than the baseline? Metric by metric, with an interval for the change and a tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import NormalDist

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.bootstrap import difference_error, mean_interval, mean_of_cases
from humanoid_sim.regress.results import Comparison, Detectable, Episode, MetricInfo, PolicyRun, Verdict
from humanoid_sim.regress.suite import Suite

__all__ = ["POWER", "compare_runs", "detectable_changes", "is_paired"]

POWER = 0.8
"""Probability with which a change of the size that is announced is found."""

_Values = dict[str, dict[int, float]]
"""Case to seed to value."""


def compare_runs(
    suite: Suite, metrics: Sequence[MetricInfo], baseline: PolicyRun, run: PolicyRun
) -> tuple[Comparison, ...]:
    """Every metric of a run against the baseline's, in the order of `metrics`.

    Runs over the same seeds are compared pair by pair, so that what a seed does to both cancels; runs over other seeds
    case by case. The confidence of the suite is that of all intervals together (Bonferroni), so that a suite does not
    raise more false alarms for having more metrics.
    """
    paired = is_paired(baseline, run)
    confidence = _each(suite, metrics)
    return tuple(_compare(suite, metric, baseline, run, paired, confidence) for metric in metrics)


def is_paired(baseline: PolicyRun, run: PolicyRun) -> bool:
    """Whether one ran all the seeds that the other ran: then those that both ran are compared pair by pair."""
    before, after = ({(e.case, e.seed) for e in r.episodes} for r in (baseline, run))
    return before <= after or after <= before


def detectable_changes(suite: Suite, metrics: Sequence[MetricInfo], baseline: PolicyRun) -> tuple[Detectable, ...]:
    """How small a worsening the suite finds with a probability of `POWER`: the tolerance and (z + z') standard errors.

    From the baseline and the suite's number of seeds alone, as if the candidate were run with other seeds: comparing
    pair by pair can only make it smaller. A metric that no episode of the baseline has is left out.
    """
    quantile = NormalDist().inv_cdf
    factor = quantile(0.5 + 0.5 * _each(suite, metrics)) + quantile(POWER)
    found = []
    for metric in metrics:
        cases = _arrays(_values(metric.name, baseline.episodes))
        if not cases:
            continue
        mean = mean_of_cases(cases)
        tolerance = suite.tolerance(metric.name, mean)
        error = _share_error(cases, suite.seeds) if metric.unit == "share" else difference_error(cases, suite.seeds)
        change = tolerance + factor * error
        found.append(Detectable(metric=metric.name, baseline=mean, tolerance=tolerance, change=change, power=POWER))
    return tuple(found)


def _each(suite: Suite, metrics: Sequence[MetricInfo]) -> float:
    """Confidence of each of the intervals that are to hold together."""
    return 1.0 - (1.0 - suite.confidence) / max(len(metrics), 1)


def _share_error(cases: Sequence[FloatArray], count: int) -> float:
    """Of a share: none failing of n does not mean that none ever would (Laplace's rule: (k + 1) / (n + 2))."""
    n = sum(len(values) for values in cases)
    share = (sum(float(values.sum()) for values in cases) + 1.0) / (n + 2.0)
    return math.sqrt(share * (1.0 - share) * (1.0 / n + 1.0 / (count * len(cases))))


def _compare(
    suite: Suite, metric: MetricInfo, baseline: PolicyRun, run: PolicyRun, paired: bool, confidence: float
) -> Comparison:
    everything = _values(metric.name, baseline.episodes), _values(metric.name, run.episodes)
    before, after = everything
    if paired:
        before, after = _common(before, after), _common(after, before)
    else:
        cases = before.keys() & after.keys()
        before, after = ({case: values[case] for case in values if case in cases} for values in (before, after))
    old, new = _arrays(before), _arrays(after)
    if not new or not old:
        return _unmeasured(metric, _arrays(everything[0]), _arrays(everything[1]), paired)
    plus, minus = ([b - a for a, b in zip(old, new, strict=True)], []) if paired else (new, old)
    interval = mean_interval(plus, minus, confidence, suite.resamples)
    tolerance = suite.tolerance(metric.name, mean_of_cases(old))
    return Comparison(
        metric=metric.name,
        verdict=_verdict(metric, interval.low, interval.high, tolerance),
        baseline=mean_of_cases(old),
        candidate=mean_of_cases(new),
        change=interval.mean,
        low=interval.low,
        high=interval.high,
        tolerance=tolerance,
        episodes=sum(len(values) for values in new),
        paired=paired,
    )


def _unmeasured(metric: MetricInfo, old: list[FloatArray], new: list[FloatArray], paired: bool) -> Comparison:
    return Comparison(
        metric=metric.name,
        verdict="unmeasured",
        baseline=mean_of_cases(old) if old else None,
        candidate=mean_of_cases(new) if new else None,
        change=None,
        low=None,
        high=None,
        tolerance=None,
        episodes=0,
        paired=paired,
    )


def _verdict(metric: MetricInfo, low: float, high: float, tolerance: float) -> Verdict:
    worsening = (low, high) if metric.better == "lower" else (-high, -low)
    if worsening[0] > tolerance:
        return "worse"
    if worsening[1] < -tolerance:
        return "better"
    return "same" if worsening[1] <= tolerance else "unclear"


def _values(metric: str, episodes: Iterable[Episode]) -> _Values:
    found: _Values = {}
    for episode in episodes:
        value = episode.metrics.get(metric)
        if value is not None:
            found.setdefault(episode.case, {})[episode.seed] = value
    return found


def _common(values: _Values, others: _Values) -> _Values:
    """The values whose case and seed the others have too."""
    shared = {
        case: {seed: value for seed, value in by_seed.items() if seed in others.get(case, {})}
        for case, by_seed in values.items()
    }
    return {case: by_seed for case, by_seed in shared.items() if by_seed}


def _arrays(values: _Values) -> list[FloatArray]:
    """One array per case, both in a fixed order."""
    return [np.array([values[case][seed] for seed in sorted(values[case])]) for case in sorted(values)]
