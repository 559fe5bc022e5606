"""Verdicts: what is worse is called worse, what is not is not, and the suite says beforehand what it can tell."""

from __future__ import annotations

import math

import numpy as np
import pytest
from regress_runs import episode, run, tiny_suite, values

from humanoid_sim.regress.compare import (
    POWER,
    compare_runs,
    detectable_changes,
    difference_error,
    mean_interval,
    mean_of_cases,
)
from humanoid_sim.regress.results import Candidate, Comparison, PolicyRun
from humanoid_sim.regress.suite import Suite, Tolerance

CASES = ("a", "b")


def measured(mean: float, *, seed: int = 0, seeds: range = range(10), spread: float = 0.1) -> PolicyRun:
    """A metric around a mean, 2 in case a and 4 in case b times `mean`, with noise that is drawn per run."""
    generator = np.random.default_rng(seed)
    level = {"a": 2.0, "b": 4.0}
    return values("joint_error", lambda case, _: mean * level[case] + spread * generator.normal(), CASES, seeds)


def compare(suite: Suite, baseline: PolicyRun, candidate: PolicyRun) -> Comparison:
    """The first metric's."""
    return compare_runs(suite, suite.metrics, baseline, candidate)[0]


def test_a_policy_is_the_same_as_itself() -> None:
    comparison = compare(tiny_suite(), measured(1.0), measured(1.0))
    assert (comparison.verdict, comparison.change, comparison.low, comparison.high) == ("same", 0.0, 0.0, 0.0)
    assert comparison.paired
    assert comparison.episodes == 20
    assert comparison.tolerance == pytest.approx(0.05 * 3.0, rel=0.03)


@pytest.mark.parametrize(
    ("factor", "spread", "verdict"),
    [(1.15, 0.1, "worse"), (0.85, 0.1, "better"), (1.01, 0.02, "same"), (0.97, 0.02, "same"), (1.05, 0.3, "unclear")],
)
def test_verdicts(factor: float, spread: float, verdict: str) -> None:
    comparison = compare(tiny_suite(), measured(1.0, seed=1, spread=spread), measured(factor, seed=2, spread=spread))
    assert comparison.verdict == verdict


def test_higher_is_better_where_it_is() -> None:
    suite = tiny_suite(survival=Tolerance(absolute=0.05))
    full = values("survival", lambda *_: 1.0, CASES, range(5))
    half = values("survival", lambda _, seed: 0.5 if seed % 2 else 0.7, CASES, range(5))
    assert compare(suite, full, half).verdict == "worse"
    assert compare(suite, half, full).verdict == "better"


def test_pairs_see_what_the_spread_of_the_seeds_hides() -> None:
    """Seeds differ by far more than the policies, but in the same way for both."""

    def baseline(_: str, seed: int) -> float:
        return 1.0 + seed

    def candidate(_: str, seed: int) -> float:
        return (1.0 + seed) * 1.1 + 0.001 * (seed % 3)

    suite = tiny_suite()
    paired = compare(
        suite, values("joint_error", baseline, CASES, range(10)), values("joint_error", candidate, CASES, range(10))
    )
    assert (paired.paired, paired.verdict) == (True, "worse")
    later = values("joint_error", lambda case, seed: candidate(case, seed - 10), CASES, range(10, 20))
    unpaired = compare(suite, values("joint_error", baseline, CASES, range(10)), later)
    assert (unpaired.paired, unpaired.verdict) == (False, "unclear")
    assert unpaired.change == pytest.approx(paired.change, rel=1e-12)


def test_a_run_of_some_of_the_seeds_is_still_paired() -> None:
    baseline, candidate = measured(1.0), measured(1.0, seeds=range(3))
    some = run(e for e in baseline.episodes if e.seed < 3)
    assert compare(tiny_suite(), baseline, some).change == 0.0
    assert compare(tiny_suite(), baseline, candidate).episodes == 6


def test_failed_episodes_are_left_out_of_errors_on_both_sides() -> None:
    def baseline(_: str, seed: int) -> float:
        return float(seed)

    def candidate(_: str, seed: int) -> float | None:
        return None if seed == 9 else float(seed)

    suite = tiny_suite()
    comparison = compare(
        suite, values("joint_error", baseline, CASES, range(10)), values("joint_error", candidate, CASES, range(10))
    )
    assert comparison.episodes == 18
    assert comparison.baseline == comparison.candidate == 4.0


def test_nothing_to_compare_is_unmeasured_and_the_failures_tell() -> None:
    suite = tiny_suite(joint_error=Tolerance(relative=0.05), faults=Tolerance(absolute=0.01))
    good = run(episode("a", seed, {"joint_error": 1.0, "faults": 0.0}) for seed in range(6))
    bad = run(episode("a", seed, {"joint_error": None, "faults": 1.0}, "action is nan") for seed in range(6))
    errors, faults, losses = compare_runs(suite, suite.metrics, good, bad)
    assert (errors.verdict, errors.change, errors.episodes) == ("unmeasured", None, 0)
    assert (errors.baseline, errors.candidate, errors.is_lost) == (1.0, None, True)
    assert (faults.verdict, faults.change) == ("worse", 1.0)
    assert (losses.verdict, losses.is_lost) == ("unmeasured", False)
    assert Candidate(run=bad, passed=False, comparisons=(errors, faults, losses)).worse == ("joint_error", "faults")


def test_failures_are_judged_whether_a_suite_names_them_or_not() -> None:
    suite = tiny_suite()
    assert [metric.name for metric in suite.metrics] == ["joint_error", "losses", "faults"]
    assert suite.tolerance("faults", 0.0) == 0.0
    good = run(episode("a", seed, {"joint_error": 1.0, "faults": 0.0, "losses": 0.0}) for seed in range(6))
    bad = run(episode("a", seed, {"joint_error": None, "faults": 1.0, "losses": 0.0}, "nan") for seed in range(6))
    verdicts = {c.metric: c.verdict for c in compare_runs(suite, suite.metrics, good, bad)}
    assert verdicts == {"joint_error": "unmeasured", "losses": "same", "faults": "worse"}


def width(comparison: Comparison) -> float:
    assert comparison.low is not None
    assert comparison.high is not None
    return comparison.high - comparison.low


def test_more_metrics_do_not_mean_more_false_alarms() -> None:
    """Each interval is wider where more of them are to hold together."""
    suite = tiny_suite()
    alone = compare(suite, measured(1.0), measured(1.0, seed=3))
    among_many = compare_runs(suite, [*suite.metrics] * 8, measured(1.0), measured(1.0, seed=3))[0]
    assert width(among_many) > 1.2 * width(alone)


def test_no_false_alarm_with_other_seeds() -> None:
    """20 tries of the same policy with other seeds, at the tolerance of the shipped suites."""
    suite = tiny_suite()
    baseline = measured(1.0, seed=100, spread=0.3)
    verdicts = [
        compare(suite, baseline, measured(1.0, seed=seed, seeds=range(10, 20), spread=0.3)).verdict
        for seed in range(20)
    ]
    assert verdicts.count("worse") == 0


def test_the_change_that_is_announced_is_found_as_often_as_announced() -> None:
    """Of 100 candidates that are worse by just that much, with other seeds, about 80 are found."""
    suite = tiny_suite()
    found = 0
    for seed in range(100):
        baseline = measured(1.0, seed=seed, spread=0.3)
        announced = detectable_changes(suite, suite.metrics, baseline)[0]
        assert announced.power == POWER
        worse = 1.0 + announced.change / announced.baseline
        candidate = measured(worse, seed=1000 + seed, seeds=range(10, 20), spread=0.3)
        found += compare(suite, baseline, candidate).verdict == "worse"
    assert 65 <= found <= 95


def test_what_is_announced_depends_on_the_number_of_seeds() -> None:
    baseline = measured(1.0)
    few, many = (detectable_changes(tiny_suite(seeds=n), tiny_suite().metrics, baseline)[0] for n in (2, 50))
    assert few.tolerance == many.tolerance < many.change < few.change


def test_no_failure_in_ten_does_not_mean_never() -> None:
    suite = tiny_suite(faults=Tolerance(absolute=0.01))
    (announced,) = detectable_changes(suite, suite.metrics, values("faults", lambda *_: 0.0, CASES, range(5)))
    assert 0.1 < announced.change < 0.6


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
