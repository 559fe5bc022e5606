"""Episodes of a candidate beside the baseline's: what lies between them, and which are worth a look."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.compare import mean_of_cases
from humanoid_sim.regress.results import Episode, MetricInfo, PolicyRun


@dataclass(frozen=True, slots=True)
class Pair:
    """A candidate's episode, and the baseline's of the same case and seed if there is one."""

    candidate: Episode
    baseline: Episode | None

    def change(self, metric: MetricInfo) -> float | None:
        """Candidate less baseline, in the metric's unit; None where one of them is missing."""
        value = self.candidate.metrics.get(metric.name)
        before = None if self.baseline is None else self.baseline.metrics.get(metric.name)
        return None if value is None or before is None else value - before


def pair_up(candidate: PolicyRun, baseline: PolicyRun | None) -> tuple[Pair, ...]:
    """Every episode of the candidate with its counterpart, in the candidate's order."""
    known = {(e.case, e.seed): e for e in baseline.episodes} if baseline is not None else {}
    return tuple(Pair(episode, known.get((episode.case, episode.seed))) for episode in candidate.episodes)


def worst(pairs: Sequence[Pair], metric: MetricInfo, count: int) -> tuple[Pair, ...]:
    """Give the episodes to look at first: failures that the baseline does not have, other failures, then by worsening.

    Where there is nothing to compare with, by the metric itself. Equals stay in their order.
    """

    def key(pair: Pair) -> tuple[int, float, float]:
        failed = bool(pair.candidate.failure)
        is_new = failed and not (pair.baseline is not None and pair.baseline.failure)
        rank = 0 if is_new else 1 if failed else 2
        value, change = pair.candidate.metrics.get(metric.name), pair.change(metric)
        size = value if change is None else change
        worsening = -np.inf if size is None else size if metric.better == "lower" else -size
        return rank, pair.candidate.duration if failed else 0.0, -worsening

    return tuple(sorted(pairs, key=key)[:count])


def by_case(values: Iterable[tuple[str, float | None]]) -> Mapping[str, FloatArray]:
    """Return the values that exist by their case, both in order of appearance."""
    found: dict[str, list[float]] = {}
    for case, value in values:
        if value is not None:
            found.setdefault(case, []).append(value)
    return {case: np.array(members) for case, members in found.items()}


def metric_values(episodes: Iterable[Episode], metric: str) -> Mapping[str, FloatArray]:
    """By case, in the metric's unit, of the episodes that have it."""
    return by_case((episode.case, episode.metrics.get(metric)) for episode in episodes)


def mean_over_cases(episodes: Sequence[Episode], metric: str) -> float | None:
    """Return the mean of the cases' means, as verdicts take it: cases weigh equally, whatever failed in them."""
    values = [*metric_values(episodes, metric).values()]
    return mean_of_cases(values) if values else None


def trace_difference(pair: Pair, name: str) -> float:
    """Root mean square of the difference of a trace over the time that both episodes have, in the trace's unit."""
    if pair.baseline is None or name not in pair.candidate.traces or name not in pair.baseline.traces:
        return 0.0
    times = np.array(pair.candidate.trace_times)
    before_times = np.array(pair.baseline.trace_times)
    if not times.size or not before_times.size:
        return 0.0
    before = np.interp(times, before_times, trace(pair.baseline, name))
    difference = (trace(pair.candidate, name) - before)[times <= before_times[-1]]
    return finite_rms(difference)


def finite_rms(values: FloatArray) -> float:
    """Root mean square of the finite values; 0 without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt((known * known).mean())) if known.size else 0.0


def trace(episode: Episode, name: str) -> FloatArray:
    """Return a trace of shape (K,); NaN where there is no value."""
    return np.array([np.nan if value is None else value for value in episode.traces[name]], dtype=np.float64)
