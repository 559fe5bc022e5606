from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.session.histogram import DurationHistogram


def histogram(durations: list[float]) -> DurationHistogram:
    result = DurationHistogram()
    for duration in durations:
        result.add(duration)
    return result


def test_an_empty_one_is_zero() -> None:
    empty = DurationHistogram()
    assert (empty.count, empty.mean, empty.max, empty.percentile(50.0)) == (0, 0.0, 0.0, 0.0)


@given(st.lists(st.floats(1e-6, 99.0), min_size=1, max_size=300), st.floats(0.0, 100.0))
def test_percentiles_are_within_five_percent(durations: list[float], percent: float) -> None:
    counted = histogram(durations)
    exact = float(np.percentile(durations, percent, method="inverted_cdf"))
    assert exact * (1 - 1e-9) <= counted.percentile(percent) <= exact * 1.05
    assert counted.max == max(durations)
    assert counted.mean == pytest.approx(np.mean(durations))
    assert counted.count == len(durations)


def test_durations_beyond_the_bins_count_at_their_ends() -> None:
    counted = histogram([0.0, -1e-9, 1e-12, 500.0])
    assert counted.max == 500.0
    assert counted.percentile(50.0) < 1.1e-7
    assert counted.percentile(100.0) == pytest.approx(100.0)


def test_memory_does_not_grow() -> None:
    counted = histogram([0.001] * 10)
    before = counted._bins.nbytes
    for _ in range(10_000):
        counted.add(0.001)
    assert counted._bins.nbytes == before
    assert counted.percentile(99.0) == pytest.approx(0.001, rel=0.05)


def test_counts_between_edges_add_up_to_all() -> None:
    histogram = DurationHistogram()
    for seconds, times in ((0.0, 3), (4e-5, 5), (2e-4, 7), (3e-3, 2), (1e6, 1)):
        for _ in range(times):
            histogram.add(seconds)
    assert histogram.counts([1e-4, 1e-3, 1e-2]) == (8, 7, 2, 1)
    assert DurationHistogram().counts([1e-3]) == (0, 0)
