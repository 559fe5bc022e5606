"""Confidence intervals by the bootstrap: how far the mean would move with other episodes of the same cases.

Cases are fixed, seeds are a sample: resampling draws seeds within each case, and the cases' means weigh equally. The
spread of a resampled mean is too narrow by √((n-1)/n) for n seeds, and is widened by that (Hesterberg 2015, "What
teachers should know about the bootstrap"). The same numbers give the same interval: the generator is seeded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.mit import FloatArray

__all__ = ["Interval", "difference_error", "mean_interval", "mean_of_cases"]

_SEED = 2026


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean and where it lies with some confidence."""

    mean: float
    low: float
    high: float


def mean_of_cases(cases: Sequence[FloatArray]) -> float:
    """The mean over cases of each case's mean; NaN without any."""
    return float(np.mean([case.mean() for case in cases])) if cases else math.nan


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
            spread += sign * _resampled_means(values, resamples, generator) / len(samples)
    mean = mean_of_cases(plus) - (mean_of_cases(minus) if minus else 0.0)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(spread, [tail, 1.0 - tail])
    return Interval(mean, mean + float(low), mean + float(high))


def _resampled_means(values: FloatArray, resamples: int, generator: np.random.Generator) -> FloatArray:
    """Means of draws with replacement, less the mean of `values`, shape (resamples,)."""
    n = len(values)
    if n < 2:
        return np.zeros(resamples)
    drawn = values[generator.integers(n, size=(resamples, n))]
    deviation: FloatArray = (drawn.mean(axis=1) - values.mean()) * math.sqrt(n / (n - 1))
    return deviation


def difference_error(cases: Sequence[FloatArray], count: int) -> float:
    """Standard error of the difference to be expected between these samples' mean and that of `count` new seeds a case.

    From the spread of the seeds within each case, which the new ones are taken to share; a case with one seed adds
    nothing.
    """
    variances = [values.var(ddof=1) * (1.0 / len(values) + 1.0 / count) for values in cases if len(values) > 1]
    return math.sqrt(sum(variances)) / len(cases) if cases else math.nan
