"""The shipped suite on real policies: what is worse is found, what is only different is not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from msgspec.structs import replace
from policies import SAMPLE, noisy_copy, swapped_copy

from humanoid_sim.regress.compare import detectable_changes, judge
from humanoid_sim.regress.executors import LocalExecutor
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.results import Candidate, PolicyRun
from humanoid_sim.regress.run import run_policy
from humanoid_sim.regress.suite import Suite
from humanoid_sim.regress.suite_file import load_suite

pytestmark = pytest.mark.slow

TRACKING = {"body_position_error", "body_orientation_error", "joint_error"}


class Field:
    """The shipped suite for the Lite, with the sample policy as its baseline."""

    def __init__(self) -> None:
        self.suite, self.folder = load_suite("lite_tracking")
        self.baseline = self.run(SAMPLE)

    def run(self, policy: Path, suite: Suite | None = None) -> PolicyRun:
        """All episodes of a policy."""
        prepared = prepare_suite(self.suite if suite is None else suite, self.folder)
        return run_policy(prepared, prepare_policy(prepared, policy), LocalExecutor())

    def judge(self, policy: Path) -> Candidate:
        """A policy against the sample."""
        return judge(self.suite, self.baseline, self.run(policy))


@pytest.fixture(scope="module")
def field() -> Field:
    return Field()


def change(candidate: Candidate, metric: str) -> float:
    (comparison,) = (c for c in candidate.comparisons if c.metric == metric)
    assert comparison.relative is not None
    return comparison.relative


def test_the_sample_policy_is_the_same_as_itself(field: Field) -> None:
    candidate = field.judge(SAMPLE)
    assert candidate.passed
    assert {comparison.verdict for comparison in candidate.comparisons} == {"same"}
    assert candidate.run.episodes == field.baseline.episodes


def test_it_says_beforehand_that_it_finds_a_tenth(field: Field) -> None:
    announced = {d.metric: d for d in detectable_changes(field.suite, field.suite.metrics, field.baseline)}
    for metric in TRACKING:
        assert announced[metric].change < 0.1 * announced[metric].baseline


@pytest.mark.timeout(1800)
def test_weight_noise_that_makes_tracking_15_percent_worse_is_found(field: Field, tmp_path: Path) -> None:
    """The noise is raised until the error is 15 % worse, and what was announced to be found by then is found."""
    scale, worse = 0.01, 0.0
    while worse < 0.15:
        scale += 0.005
        assert scale < 0.2, f"noise of {scale:g} makes tracking only {worse:.1%} worse"
        candidate = field.judge(noisy_copy(SAMPLE, tmp_path / "noisy.onnx", scale))
        worse = change(candidate, "body_position_error")
    assert worse < 0.5
    assert not candidate.passed
    assert "body_position_error" in candidate.worse
    assert set(candidate.worse) <= TRACKING


@pytest.mark.parametrize(("first", "second"), [(0, 1), (5, 12)])
def test_two_joints_in_each_others_place_are_found(field: Field, tmp_path: Path, first: int, second: int) -> None:
    candidate = field.judge(swapped_copy(SAMPLE, tmp_path / "swapped.onnx", first, second))
    assert not candidate.passed
    assert set(candidate.worse) >= TRACKING


@pytest.mark.timeout(1800)
def test_a_tenth_of_the_training_is_found(field: Field, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    policy = tmp_path / "tenth.onnx"
    command = [sys.executable, "-m", "humanoid_sim.training", "train-sample", "--output", str(policy)]
    tenth = ["--static-steps", "500", "--loop-steps", "70", "--poses", "25000", "--motions", "80"]
    subprocess.run([*command, *tenth], check=True, timeout=900, stdout=subprocess.DEVNULL)
    candidate = field.judge(policy)
    assert not candidate.passed
    assert set(candidate.worse) >= TRACKING


@pytest.mark.timeout(3600)
def test_no_false_alarm_in_20_tries_with_other_seeds(field: Field) -> None:
    """One run over 240 seeds of each case is 20 sets of 12 that the baseline was not run with."""
    suite = replace(field.suite, first_seed=1000, seeds=20 * field.suite.seeds)
    everything = field.run(SAMPLE, suite)
    alarms = []
    for begin in range(1000, 1000 + suite.seeds, field.suite.seeds):
        seeds = range(begin, begin + field.suite.seeds)
        episodes = tuple(episode for episode in everything.episodes if episode.seed in seeds)
        candidate = judge(field.suite, field.baseline, replace(everything, episodes=episodes))
        assert len(episodes) == len(field.baseline.episodes)
        assert not candidate.comparisons[0].paired
        alarms += candidate.worse
    assert alarms == []
