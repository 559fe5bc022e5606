"""Verdicts: what is worse is called worse, and what is not is not."""

import numpy as np
import pytest
from regress_runs import given, tiny_suite

from humanoid_sim.regress.compare import compare_runs, mean_interval
from humanoid_sim.regress.suite import Case, Suite, Tolerance


def figure(factor, noise=0.0, seed=0):
    """Efforts that seeds spread by far more than policies differ, in the same way for each policy."""
    generator = np.random.default_rng(seed)
    return lambda case, s: ({"a": 2.0, "b": 4.0}[case] + s) * factor + noise * generator.normal()


def compare(baseline, candidate, suite=None):
    """The effort's comparison and the names of all metrics that are worse beyond tolerance."""
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
            entry.metrics.update(vx_reached=entry.metrics["effort"], falls=0.0)
        return run

    assert compare(walk(0.8), walk(0.7), suite)[1] == ["vx_reached"]
    assert compare(walk(0.8), walk(0.9), suite)[0].verdict == "better"


@pytest.mark.parametrize("count", [1, 5])
def test_a_failure_where_the_baseline_had_none_fails_whatever_is_tolerated(count):
    suite = tiny_suite(effort=Tolerance(relative=0.05), faults=Tolerance(absolute=0.5))
    good, bad = (given(lambda case, s, n=n: None if case == "a" and s < n else 1.0 + s) for n in (0, count))
    comparison, worse = compare(good, bad, suite)
    assert worse == ["faults"]
    faults = compare_runs(suite, good, bad)[1]
    assert faults.new_failures == tuple(f"a, seed {seed}" for seed in range(count))
    assert (comparison.verdict, comparison.episodes) == ("no difference seen", 24 - count), "failed ones are left out"
    assert compare(bad, bad, suite)[1] == [], "a case that fails now and then anyway"


def test_intervals_cover_the_truth_nearly_as_often_as_they_say():
    """300 experiments of three cases with six seeds: a bootstrap of so few is a little too narrow."""
    generator = np.random.default_rng(3)
    covered = 0
    for _ in range(300):
        low, high = mean_interval([mean + generator.normal(size=6) for mean in (1.0, 2.0, 6.0)], 0.95)
        covered += low <= 3.0 <= high
    assert 0.90 <= covered / 300 <= 0.98
