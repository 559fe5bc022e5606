"""Which episodes are shown, and what lies between two of them."""

import invented
import msgspec
import numpy as np
import pytest
from invented import Behaviour

from humanoid_sim.regress.report.pairs import Pair, mean_over_cases, metric_values, pair_up, trace_difference, worst
from humanoid_sim.regress.results import MetricInfo

ERROR = MetricInfo(name="error", unit="m", better="lower", summary="")
SURVIVAL = MetricInfo(name="survival", unit="share", better="higher", summary="")


def episode(value, survival=1.0, failure="", duration=8.0, seed=0, traces=None, times=()):
    example = invented.episode("wave", seed, Behaviour())
    return msgspec.structs.replace(
        example,
        metrics={"error": value, "survival": survival},
        failure=failure,
        duration=duration,
        trace_times=tuple(times),
        traces=traces or {},
    )


def test_pairs_are_by_case_and_seed():
    new = invented.run(Behaviour(), invented.seeds(0, 3))
    old = invented.run(Behaviour(name="old"), invented.seeds(2, 3))
    pairs = pair_up(new, old)
    assert [pair.baseline is not None for pair in pairs] == [False, False, True] * 4
    assert all(pair.baseline.seed == pair.candidate.seed == 2 for pair in pairs if pair.baseline)
    assert all(pair.baseline is None for pair in pair_up(new, None))


def test_a_change_is_candidate_less_baseline():
    pair = Pair(episode(0.3, survival=0.5), episode(0.1, survival=1.0))
    assert pair.change(ERROR) == pytest.approx(0.2)
    assert pair.change(SURVIVAL) == pytest.approx(-0.5)
    assert Pair(episode(None), episode(0.1)).change(ERROR) is None
    assert Pair(episode(0.3), None).change(ERROR) is None


def test_the_worst_comes_first_whichever_way_a_metric_counts():
    pairs = [
        Pair(episode(0.3, survival=0.9, seed=0), episode(0.1, survival=0.1)),
        Pair(episode(0.2, survival=0.5, seed=1), episode(0.1, survival=1.0)),
    ]
    assert [pair.candidate.seed for pair in worst(pairs, ERROR, 2)] == [0, 1]
    assert [pair.candidate.seed for pair in worst(pairs, SURVIVAL, 2)] == [1, 0]


def test_new_failures_come_first_then_old_ones_then_the_largest_worsening():
    pairs = [
        Pair(episode(0.2, seed=0), episode(0.1)),
        Pair(episode(0.4, seed=1), episode(0.1)),
        Pair(episode(0.1, seed=2, failure="fell", duration=3.0), episode(0.1, failure="fell")),
        Pair(episode(0.1, seed=3, failure="fell", duration=2.0), episode(0.1)),
        Pair(episode(0.1, seed=4, failure="fell", duration=1.0), episode(0.1)),
        Pair(episode(0.1, seed=5), episode(0.4)),
    ]
    assert [pair.candidate.seed for pair in worst(pairs, ERROR, 5)] == [4, 3, 2, 1, 0]


def test_without_a_baseline_the_worst_value_comes_first():
    pairs = [Pair(episode(value, seed=seed), None) for seed, value in enumerate([0.1, None, 0.4])]
    assert [pair.candidate.seed for pair in worst(pairs, ERROR, 3)] == [2, 0, 1]
    steady = [Pair(episode(0.1, survival=value, seed=seed), None) for seed, value in enumerate([1.0, 0.2, 0.6])]
    assert [pair.candidate.seed for pair in worst(steady, SURVIVAL, 2)] == [1, 2]


def test_values_leave_out_what_was_not_measured():
    (values,) = metric_values([episode(0.1), episode(None), episode(0.3)], "error").values()
    assert values.tolist() == [0.1, 0.3]
    assert metric_values([], "error") == {}


def test_cases_weigh_equally():
    wave = [episode(0.1), episode(0.3), episode(None)]
    drum = msgspec.structs.replace(episode(0.6), case="drum")
    assert mean_over_cases([*wave, drum], "error") == pytest.approx(0.4)
    assert mean_over_cases([episode(None)], "error") is None


def test_traces_are_compared_over_the_time_that_both_have():
    long = episode(0.1, times=np.arange(10.0), traces={"error": tuple(np.arange(10.0))})
    short = episode(0.1, times=[0.5, 1.5], traces={"error": (0.5 + 3.0, 1.5 + 4.0)})
    assert trace_difference(Pair(short, long), "error") == pytest.approx(np.sqrt((9 + 16) / 2))
    assert trace_difference(Pair(long, short), "error") == pytest.approx(np.sqrt((3.5**2 + 3.5**2) / 2), rel=0.2)
    assert trace_difference(Pair(long, long), "error") == 0.0
    assert trace_difference(Pair(long, None), "error") == 0.0
    assert trace_difference(Pair(long, episode(0.1)), "error") == 0.0
    holes = episode(0.1, times=[0.5, 1.5], traces={"error": (None, 1.5 + 4.0)})
    assert trace_difference(Pair(holes, long), "error") == pytest.approx(4.0)
