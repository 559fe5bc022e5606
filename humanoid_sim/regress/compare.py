"""Is a candidate worse than the baseline? Metric by metric, with an interval for the change and a tolerance.

Episodes are compared pair by pair, so that what a seed does to both cancels. The intervals are by the bootstrap: how
far the mean would move with other seeds. These are drawn within each case, and the cases' means weigh equally. The
generator is seeded: the same numbers, the same interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.results import WORSE, Comparison, PolicyRun, Verdict
from humanoid_sim.regress.suite import FAILURES, Metric, Suite

_CONFIDENCE = 0.95  # that none of a candidate's intervals misses its change
_RESAMPLES, _SEED = 10_000, 2026
_ROUNDING = 1e-9  # in any unit: machines of a kind may differ in the last bits


def compare_runs(suite: Suite, baseline: PolicyRun | None, run: PolicyRun) -> tuple[Comparison, ...]:
    """Return every metric that the suite judges of a run, against the baseline's if there is one."""
    return tuple(_compare(suite, metric, baseline, run) for metric in suite.metrics)


def _compare(suite: Suite, metric: Metric, baseline: PolicyRun | None, run: PolicyRun) -> Comparison:
    name, new = metric.name, run.values(metric.name)
    alone = Comparison(metric=name, unit=metric.unit, verdict="not compared")
    if baseline is None:
        cases = [np.array([*values.values()]) for values in new.values()]
        return replace(alone, candidate=_mean(cases) if cases else None, episodes=sum(map(len, cases)))
    old = baseline.values(name)
    pairs = {case: sorted(old[case].keys() & new[case].keys()) for case in sorted(old.keys() & new.keys())}
    was = [np.array([old[case][seed] for seed in seeds]) for case, seeds in pairs.items() if seeds]
    now = [np.array([new[case][seed] for seed in seeds]) for case, seeds in pairs.items() if seeds]
    if not was:
        return replace(alone, verdict=WORSE) if old and not new else alone
    confidence = 1.0 - (1.0 - _CONFIDENCE) / len(suite.metrics)  # Bonferroni: more metrics raise no more alarms
    differences = [after - before for before, after in zip(was, now, strict=True)]
    tolerance = suite.tolerance(name, _mean(was))
    low, high = mean_interval(differences, confidence)
    one_each = max(map(len, differences)) == 1  # one value has no spread
    never_failed = {case for case, values in old.items() if name in FAILURES and not any(values.values())}
    new_failures = [f"{e.case}, seed {e.seed}" for e in run.episodes if e.case in never_failed and e.metrics.get(name)]
    verdict: Verdict = "no difference seen" if one_each else _verdict(metric, low, high, tolerance)
    return replace(
        alone,
        verdict=WORSE if new_failures else verdict,
        candidate=_mean(now),
        baseline=_mean(was),
        change=_mean(differences),
        low=low,
        high=high,
        tolerance=tolerance,
        episodes=sum(map(len, now)),
        new_failures=tuple(new_failures),
    )


def _verdict(metric: Metric, low: float, high: float, tolerance: float) -> Verdict:
    least, most = (low, high) if metric.better == "lower" else (-high, -low)  # worsening
    if max(-least, most) < _ROUNDING:
        return "no difference seen"
    if least > tolerance:
        return WORSE
    if least > 0.0:
        return "worse within tolerance"
    return "better" if most < 0.0 else "no difference seen"


def _mean(cases: Sequence[FloatArray]) -> float:
    return float(np.mean([case.mean() for case in cases]))


def mean_interval(cases: Sequence[FloatArray], confidence: float) -> tuple[float, float]:
    """Return the two-sided interval of the mean over cases, each a value per seed."""
    generator = np.random.default_rng(_SEED)
    spread = np.zeros(_RESAMPLES)
    for values in cases:
        n = len(values)
        if n > 1:  # the factor makes up for the small spread of few values
            drawn = values[generator.integers(n, size=(_RESAMPLES, n))].mean(axis=1)
            spread += (drawn - values.mean()) * math.sqrt(n / (n - 1)) / len(cases)
    mean, tail = _mean(cases), 0.5 * (1.0 - confidence)
    low, high = np.quantile(spread, [tail, 1.0 - tail])
    return mean + float(low), mean + float(high)
