"""Verdicts: what is worse is called worse, and what is not is not."""

import numpy as np
import pytest
from msgspec.structs import replace
from regress_runs import episode, run, tiny_suite, values

from humanoid_sim.regress.compare import (
    compare_runs,
    judge,
    mean_interval,
)
from humanoid_sim.regress.results import FAILING, Candidate, describe_change
from humanoid_sim.regress.suite import Case, Tolerance

CASES = ("a", "b")


def measured(mean, *, seed=0, seeds=range(10), spread=0.1):
    """A metric around a mean, 2 in case a and 4 in case b times `mean`, with noise that is drawn per run."""
    generator = np.random.default_rng(seed)
    level = {"a": 2.0, "b": 4.0}
    return values("joint_error", lambda case, _: mean * level[case] + spread * generator.normal(), CASES, seeds)


def compare(suite, baseline, candidate):
    """The first metric's."""
    return compare_runs(suite, suite.metrics, baseline, candidate)[0]


def test_a_policy_is_the_same_as_itself():
    comparison = compare(tiny_suite(), measured(1.0), measured(1.0))
    assert (comparison.verdict, comparison.change, comparison.low, comparison.high) == (
        "no difference seen",
        0.0,
        0.0,
        0.0,
    )
    assert comparison.paired
    assert comparison.episodes == 20
    assert comparison.tolerance == pytest.approx(0.05 * 3.0, rel=0.03)


@pytest.mark.parametrize(
    ("factor", "spread", "verdict"),
    [
        (1.15, 0.1, "worse beyond tolerance"),
        (0.85, 0.1, "better"),
        (1.01, 0.02, "worse within tolerance"),
        (1.0, 0.02, "no difference seen"),
        (0.97, 0.02, "better"),
        (1.05, 0.3, "unclear"),
        (1.05, 0.1, "worse, perhaps beyond tolerance"),
    ],
)
def test_verdicts(factor, spread, verdict):
    comparison = compare(tiny_suite(), measured(1.0, seed=1, spread=spread), measured(factor, seed=2, spread=spread))
    assert comparison.verdict == verdict


def test_pairs_see_what_the_spread_of_the_seeds_hides():
    """Seeds differ by far more than the policies, but in the same way for both."""

    def baseline(_, seed):
        return 1.0 + seed

    def candidate(_, seed):
        return (1.0 + seed) * 1.1 + 0.001 * (seed % 3)

    suite = tiny_suite()
    paired = compare(
        suite, values("joint_error", baseline, CASES, range(10)), values("joint_error", candidate, CASES, range(10))
    )
    assert (paired.paired, paired.verdict) == (True, "worse beyond tolerance")
    later = values("joint_error", lambda case, seed: candidate(case, seed - 10), CASES, range(10, 20))
    unpaired = compare(suite, values("joint_error", baseline, CASES, range(10)), later)
    assert (unpaired.paired, unpaired.verdict) == (False, "unclear")
    assert unpaired.change == pytest.approx(paired.change, rel=1e-12)


def test_failed_episodes_are_left_out_of_errors_on_both_sides():
    def baseline(_, seed):
        return float(seed)

    def candidate(_, seed):
        return None if seed == 9 else float(seed)

    suite = tiny_suite()
    comparison = compare(
        suite, values("joint_error", baseline, CASES, range(10)), values("joint_error", candidate, CASES, range(10))
    )
    assert comparison.episodes == 18
    assert comparison.baseline == comparison.candidate == 4.0


def test_nothing_to_compare_is_unmeasured_and_the_failures_tell():
    suite = tiny_suite(joint_error=Tolerance(relative=0.05), faults=Tolerance(absolute=0.01))
    good = run(episode("a", seed, {"joint_error": 1.0, "faults": 0.0}) for seed in range(6))
    bad = run(episode("a", seed, {"joint_error": None, "faults": 1.0}, "action is nan") for seed in range(6))
    errors, faults, losses = compare_runs(suite, suite.metrics, good, bad)
    assert (errors.verdict, errors.change, errors.episodes) == ("lost", None, 0)
    assert (errors.baseline, errors.candidate) == (1.0, None)
    assert (faults.verdict, faults.change) == ("worse beyond tolerance", 1.0)
    assert losses.verdict == "unmeasured"
    assert Candidate(run=bad, passed=False, comparisons=(errors, faults, losses)).worse == ("joint_error", "faults")


def test_failures_are_judged_whether_a_suite_names_them_or_not():
    suite = tiny_suite()
    assert [metric.name for metric in suite.metrics] == ["joint_error", "losses", "faults"]
    assert suite.tolerance("faults", 0.0) == 0.0
    good = run(episode("a", seed, {"joint_error": 1.0, "faults": 0.0, "losses": 0.0}) for seed in range(6))
    bad = run(episode("a", seed, {"joint_error": None, "faults": 1.0, "losses": 0.0}, "nan") for seed in range(6))
    verdicts = {c.metric: c.verdict for c in compare_runs(suite, suite.metrics, good, bad)}
    assert verdicts == {"joint_error": "lost", "losses": "no difference seen", "faults": "worse beyond tolerance"}


def test_no_false_alarm_with_other_seeds():
    """20 tries of the same policy with other seeds, at the tolerance of the shipped suites."""
    suite = tiny_suite()
    baseline = measured(1.0, seed=100, spread=0.3)
    verdicts = [
        compare(suite, baseline, measured(1.0, seed=seed, seeds=range(10, 20), spread=0.3)).verdict
        for seed in range(20)
    ]
    assert verdicts.count("worse beyond tolerance") == 0


def test_intervals_cover_the_truth_as_often_as_they_say():
    """300 experiments of three cases with ten seeds: 95 % of the intervals hold the mean, give or take chance."""
    generator = np.random.default_rng(3)
    covered = 0
    for _ in range(300):
        cases = [mean + generator.normal(size=10) for mean in (1.0, 2.0, 6.0)]
        interval = mean_interval(cases, [], 0.95, 500)
        covered += interval.low <= 3.0 <= interval.high
    assert 0.91 <= covered / 300 <= 0.98


def flags(metric, failing, name="policy", seeds=range(12)):
    """A run in which some episodes failed, as a fault or a loss."""
    return run(
        (
            episode(
                case,
                seed,
                {"joint_error": None if (case, seed) in failing else 1.0 + 0.01 * (seed % 12)}
                | {"losses": 0.0, "faults": 0.0, metric: float((case, seed) in failing)},
                "action is nan" if (case, seed) in failing else "",
            )
            for case in ("a", "b", "c", "d")
            for seed in seeds
        ),
        name,
    )


@pytest.mark.parametrize("metric", ["faults", "losses"])
@pytest.mark.parametrize("count", [1, 5])
def test_a_failure_where_the_baseline_had_none_fails(metric, count):
    """The tolerance for the share of failures, and the interval, do not cover for it."""
    suite = tiny_suite("abcd", 12, joint_error=Tolerance(relative=0.05), **{metric: Tolerance(absolute=0.3)})
    failing = {("a", seed) for seed in range(count)}
    candidate = judge(suite, flags(metric, set()), flags(metric, failing))
    assert not candidate.passed
    assert candidate.worse == (metric,)
    found = {c.metric: c for c in candidate.comparisons}
    assert found[metric].new_failures == tuple(f"a, seed {seed}" for seed in range(count))
    assert found[metric].tolerance == 0.0
    assert found["joint_error"].left_out == count
    assert found["joint_error"].episodes == 48 - count
    assert found["joint_error"].verdict == "no difference seen"
    text = describe_change(suite.metrics[0], found["joint_error"])
    assert text.endswith(f"; without {count} of 48 pairs in which an episode failed")


def test_a_metric_of_some_cases_leaves_out_failures_of_those_alone():
    """How much of vx is reached is not measured on the way sideways, whether the robot falls there or not."""
    ways = {"forward": (0.5, 0.0, 0.0), "sideways": (0.0, 0.5, 0.0)}
    suite = replace(
        tiny_suite(seeds=6),
        task="velocity",
        cases=tuple(Case(name=name, command=command, duration=2.0) for name, command in ways.items()),
        tolerances={"vx_reached": Tolerance(relative=0.05), "tilt": Tolerance(relative=0.1)},
    )
    fallen = {("sideways", 0), ("sideways", 1), ("forward", 2)}

    def walk(case, seed):
        fell = (case, seed) in fallen
        reached = 0.8 + 0.01 * seed if case == "forward" and not fell else None
        metrics = {"vx_reached": reached, "tilt": None if fell else 0.1, "falls": float(fell), "faults": 0.0}
        return episode(case, seed, metrics, "fell" if fell else "")

    both = run(walk(case, seed) for case in ways for seed in range(6))
    found = {c.metric: c for c in compare_runs(suite, suite.metrics, both, both)}
    assert (found["vx_reached"].left_out, found["vx_reached"].episodes) == (1, 5)
    assert (found["tilt"].left_out, found["tilt"].episodes) == (3, 9)
    assert [case.case for case in found["vx_reached"].cases] == ["forward"]
    aside = replace(suite, cases=suite.cases[1:])
    assert [metric.name for metric in aside.metrics] == ["tilt", "falls", "faults"]


def test_few_seeds_leave_it_undecided_where_they_cannot_judge():
    """Nobody may take a run that could not see a fall for one that saw none."""
    old = values("joint_error", lambda _, s: 1.0 + 0.1 * s, "ab", [0, 1])
    new = values("joint_error", lambda _, s: 1.1 - 0.1 * s, "ab", [0, 1])
    candidate = judge(tiny_suite("ab", 2), old, new)
    assert (candidate.worse, candidate.unclear, candidate.few_seeds) == ((), ("joint_error",), 2)
    assert candidate.undecided
    assert not candidate.passed
    same = judge(tiny_suite("ab", 2), old, old)
    assert (same.passed, same.undecided) == (True, False), "what is the same to the bit needs no more seeds"
    even = values("joint_error", lambda _, s: 1.0 + 0.1 * (s % 2), "ab", range(6))
    odd = values("joint_error", lambda _, s: 1.1 - 0.1 * (s % 2), "ab", range(6))
    enough = judge(tiny_suite("ab", 6), even, odd)
    assert (enough.unclear, enough.few_seeds, enough.passed) == (("joint_error",), None, True)


def one_motion(factor, spread=0.01, seed=0):
    """Four motions, of which the first is worse by a factor."""
    generator = np.random.default_rng(seed)
    return values(
        "joint_error",
        lambda case, s: (1.0 + 0.1 * s) * (factor if case == "a" else 1.0) + spread * generator.normal(),
        ("a", "b", "c", "d"),
        range(12),
    )


def test_one_motion_that_is_17_percent_worse_fails_inside_a_mean_that_is_not():
    suite = tiny_suite("abcd", 12)
    comparison = compare(suite, one_motion(1.0), one_motion(1.17, seed=1))
    assert comparison.relative is not None
    assert comparison.relative < 0.05 == suite.tolerances["joint_error"].relative
    assert comparison.verdict == "worse beyond tolerance"
    assert [case.verdict in FAILING for case in comparison.cases] == [True, False, False, False]
    assert comparison.cases[0].change / comparison.cases[0].baseline == pytest.approx(0.17, abs=0.01)
    assert comparison.reasons.startswith("in a by +1")
    assert compare(suite, one_motion(1.0), one_motion(1.08, seed=1)).verdict != "worse beyond tolerance"
