"""Verdicts: what is worse is called worse, and what is not is not."""

import numpy as np
import pytest
from regress_runs import given, tiny_suite

from humanoid_sim.regress.compare import compare_runs, mean_interval
from humanoid_sim.regress.suite import Case, Suite, Tolerance


def figure(factor, noise=0.0, seed=0):
    """Joint errors that seeds spread by far more than policies differ, in the same way for each policy."""
    generator = np.random.default_rng(seed)
    return lambda case, s: ({"a": 2.0, "b": 4.0}[case] + s) * factor + noise * generator.normal()


def compare(baseline, candidate, suite=None):
    """The joint error's comparison and the names of all metrics that are worse beyond tolerance."""
    found = compare_runs(tiny_suite() if suite is None else suite, baseline, candidate)
    return found[0], [c.metric for c in found if c.verdict == "worse beyond tolerance"]


@pytest.mark.parametrize(
    ("factor", "noise", "verdict"),
    [
        (1.0, 0.1, "no difference seen"),
        (1.0 + 1e-12, 0.0, "no difference seen"),
        (1.02, 0.01, "worse within tolerance"),
        (1.1, 0.1, "worse beyond tolerance"),
        (0.95, 0.1, "better"),
    ],
)
def test_verdicts(factor, noise, verdict):
    comparison, _ = compare(given(figure(1.0)), given(figure(factor, noise)))
    assert comparison.verdict == verdict
    assert comparison.episodes == 24
    assert comparison.baseline == pytest.approx(8.5)
    assert comparison.tolerance == pytest.approx(0.05 * 8.5)
    assert comparison.change == pytest.approx((factor - 1.0) * 8.5, abs=noise)
    assert comparison.low <= comparison.change <= comparison.high


def test_what_is_higher_the_better_is_worse_where_it_is_lower():
    suite = Suite(
        name="walk",
        task="velocity",
        cases=(Case(name="a", command=(0.5, 0.0, 0.0), duration=2.0),),
        seeds=12,
        tolerances={"vx_reached": Tolerance(relative=0.05), "vy_reached": Tolerance(relative=0.05)},
    )
    assert [metric.name for metric in suite.metrics] == ["vx_reached", "falls", "faults"], "no case moves along y"

    def walk(reached):
        run = given(lambda _, seed: reached + 0.01 * seed, "a")
        for entry in run.episodes:
            entry.metrics.update(vx_reached=entry.metrics["joint_error"], falls=0.0)
        return run

    assert compare(walk(0.8), walk(0.7), suite)[1] == ["vx_reached"]
    assert compare(walk(0.8), walk(0.9), suite)[0].verdict == "better"


def test_one_motion_that_is_much_worse_fails_inside_a_mean_that_is_not():
    def policy(factor, seed):
        noise = np.random.default_rng(seed)
        return lambda case, s: (1.0 + 0.1 * s) * (factor if case == "a" else 1.0) + 0.01 * noise.normal()

    comparison, worse = compare(given(policy(1.0, 0), "abcd"), given(policy(1.17, 1), "abcd"), tiny_suite("abcd"))
    assert comparison.change < comparison.tolerance
    assert (worse, list(comparison.worse_cases)) == (["joint_error"], ["a"])
    assert comparison.worse_cases["a"] == pytest.approx(0.17 * 1.55, abs=0.02)
    assert "; a +" in comparison.text
    assert compare(given(policy(1.0, 0), "abcd"), given(policy(1.08, 1), "abcd"), tiny_suite("abcd"))[1] == []


@pytest.mark.parametrize("count", [1, 5])
def test_a_failure_where_the_baseline_had_none_fails_whatever_is_tolerated(count):
    suite = tiny_suite(joint_error=Tolerance(relative=0.05), faults=Tolerance(absolute=0.5))
    good, bad = (given(lambda case, s, n=n: None if case == "a" and s < n else 1.0 + s) for n in (0, count))
    comparison, worse = compare(good, bad, suite)
    assert worse == ["faults"]
    faults = compare_runs(suite, good, bad)[1]
    assert faults.new_failures == tuple(f"a, seed {seed}" for seed in range(count))
    assert (comparison.verdict, comparison.episodes) == ("no difference seen", 24 - count), "failed ones are left out"
    assert compare(bad, bad, suite)[1] == [], "a case that fails now and then anyway"


def test_intervals_cover_the_truth_as_often_as_they_say():
    """300 experiments of three cases with six seeds: 95 % of the intervals hold the mean, give or take chance."""
    generator = np.random.default_rng(3)
    covered = 0
    for _ in range(300):
        interval = mean_interval([mean + generator.normal(size=6) for mean in (1.0, 2.0, 6.0)], 0.95)
        covered += interval.low <= 3.0 <= interval.high
    assert 0.92 <= covered / 300 <= 0.98


def test_policies_that_are_equally_good_raise_no_alarm():
    """20 tries of policies that differ by chance alone, at the tolerance of the shipped suites."""
    alarms = [compare(given(figure(1.0, 0.5, seed)), given(figure(1.0, 0.5, 100 + seed)))[1] for seed in range(20)]
    assert alarms == [[]] * 20
