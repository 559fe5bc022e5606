"""Intervals that hold what they promise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from humanoid_sim.regress.bootstrap import difference_error, mean_interval, mean_of_cases


def test_cases_weigh_equally() -> None:
    cases = [np.array([1.0, 3.0]), np.array([10.0, 10.0, 10.0, 10.0])]
    assert mean_of_cases(cases) == 6.0
    assert math.isnan(mean_of_cases([]))


def test_no_spread_no_interval() -> None:
    interval = mean_interval([np.full(5, 2.0), np.full(3, 4.0)], [], 0.95, 1000)
    assert (interval.mean, interval.low, interval.high) == (3.0, 3.0, 3.0)


def test_the_same_numbers_give_the_same_interval() -> None:
    values = [np.random.default_rng(0).normal(size=12)]
    assert mean_interval(values, [], 0.95, 2000) == mean_interval(values, [], 0.95, 2000)


def test_an_interval_of_a_large_sample_is_that_of_the_normal_distribution() -> None:
    values = np.random.default_rng(1).normal(loc=5.0, scale=2.0, size=400)
    interval = mean_interval([values], [], 0.95, 5000)
    half = 1.96 * values.std(ddof=1) / 20.0
    assert interval.mean == values.mean()
    assert interval.low == pytest.approx(values.mean() - half, abs=0.01)
    assert interval.high == pytest.approx(values.mean() + half, abs=0.01)


def test_samples_that_are_not_paired_add_their_variances() -> None:
    generator = np.random.default_rng(2)
    plus, minus = generator.normal(3.0, 2.0, 300), generator.normal(1.0, 1.5, 200)
    interval = mean_interval([plus], [minus], 0.95, 5000)
    half = 1.96 * math.sqrt(plus.var(ddof=1) / 300 + minus.var(ddof=1) / 200)
    assert interval.mean == pytest.approx(plus.mean() - minus.mean(), abs=1e-12)
    assert interval.high - interval.low == pytest.approx(2.0 * half, rel=0.03)


def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    """300 experiments of three cases with ten seeds: 95 % of the intervals hold the mean, give or take chance."""
    generator = np.random.default_rng(3)
    covered = 0
    for _ in range(300):
        cases = [mean + generator.normal(size=10) for mean in (1.0, 2.0, 6.0)]
        interval = mean_interval(cases, [], 0.95, 500)
        covered += interval.low <= 3.0 <= interval.high
    assert 0.91 <= covered / 300 <= 0.98


def test_the_error_of_a_difference_to_new_seeds() -> None:
    cases = [np.array([1.0, 3.0]), np.array([2.0, 2.0, 5.0])]
    expected = math.sqrt(2.0 * (1 / 2 + 1 / 4) + 3.0 * (1 / 3 + 1 / 4)) / 2
    assert difference_error(cases, 4) == pytest.approx(expected, rel=1e-12)
    assert difference_error([np.array([7.0])], 4) == 0.0
