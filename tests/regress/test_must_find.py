"""The shipped suite on real policies: what is worse is found, what is only different is not."""

from functools import cached_property
from time import perf_counter

import pytest
from msgspec.structs import replace
from policies import G1_SCENE, G1_WALKER, SAMPLE, WALKER, noisy_copy
from published import needs_policies

from humanoid_sim.regress.compare import judge
from humanoid_sim.regress.executors import run_locally
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.run import run_policy
from humanoid_sim.regress.suite import load_suite

pytestmark = pytest.mark.soak

TRACKING = {"body_position_error", "body_orientation_error", "joint_error"}


class Field:
    """A shipped suite, by default the Lite's, with a policy as its baseline."""

    def __init__(self, name="lite_tracking", policy=SAMPLE, robot=None):
        self.suite, self.folder = load_suite(name)
        self.policy, self.robot = policy, robot

    @cached_property
    def baseline(self):
        return self.run(self.policy)

    def run(self, policy, suite=None):
        """All episodes of a policy."""
        prepared = prepare_suite(self.suite if suite is None else suite, self.folder, self.robot)
        return run_policy(prepare_policy(prepared, policy), run_locally)

    def judge(self, policy, seeds=None):
        """A policy against the baseline, with the suite's seeds or more."""
        suite = replace(self.suite, seeds=self.suite.seeds if seeds is None else seeds)
        return judge(self.suite, self.baseline, self.run(policy, suite))

    def alarms(self, tries):
        """The metrics that the baseline's own policy is called worse in, with seeds that the baseline did not have."""
        suite = replace(self.suite, first_seed=1000, seeds=tries * self.suite.seeds)
        everything = self.run(self.policy, suite)
        alarms = []
        for begin in range(1000, 1000 + suite.seeds, self.suite.seeds):
            seeds = range(begin, begin + self.suite.seeds)
            episodes = tuple(episode for episode in everything.episodes if episode.seed in seeds)
            candidate = judge(self.suite, self.baseline, replace(everything, episodes=episodes))
            assert len(episodes) == len(self.baseline.episodes)
            assert not candidate.comparisons[0].paired
            alarms += candidate.worse
        return alarms


@pytest.fixture(scope="module")
def field():
    return Field()


def change(candidate, metric):
    (comparison,) = (c for c in candidate.comparisons if c.metric == metric)
    assert comparison.relative is not None
    return comparison.relative


def test_the_sample_policy_is_the_same_as_itself(field):
    candidate = field.judge(SAMPLE)
    assert candidate.passed
    assert {comparison.verdict for comparison in candidate.comparisons} == {"no difference seen"}
    assert candidate.run.episodes == field.baseline.episodes


@pytest.mark.timeout(1800)
def test_weight_noise_that_makes_tracking_15_percent_worse_is_found(field, tmp_path):
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


@pytest.mark.timeout(3600)
def test_no_false_alarm_in_many_tries_with_other_seeds(field, request):
    """One run over 240 seeds of each case is 20 sets of 12 that the baseline was not run with; 6 by default."""
    assert field.alarms(20 if request.config.getoption("--complete") else 6) == []


HEADINGS = ("policy", "candidate", "verdict", "metric", "change", "between", "s")


def table_row(policy, name, candidate, metric, seconds):
    (found,) = (c for c in candidate.comparisons if c.metric == metric)
    unit = METRICS["velocity"][metric].info.unit
    change, low, high = (found.share(value, unit) for value in (found.change, found.low, found.high))
    return policy, name, found.verdict, metric, f"{change}; {found.reasons}", f"{low} to {high}", f"{seconds:.0f}"


@needs_policies
@pytest.mark.timeout(10800)
@pytest.mark.parametrize("robot", ["lite_biped", "g1"])
def test_walking_candidates(robot, tmp_path, request, table_of):
    if not request.config.getoption("--complete"):
        pytest.skip("an hour of episodes: with --complete")
    walker, place, amplitude = (WALKER, robot, 0.3) if robot == "lite_biped" else (G1_WALKER, str(G1_SCENE), 0.5)
    field = Field("velocity", walker.path, place)
    rows = table_of("regress: candidates that walk", HEADINGS)
    for name, make, metric, verdict, seeds in (
        ("90 % of the command", lambda file: walker.slowed(file, 0.9), "vx_reached", "worse beyond tolerance", None),
        ("5 % noise on actions", lambda file: walker.noisy(file, 0.05), "action_rate", "worse within tolerance", None),
        (
            "a knee chatters",
            lambda file: walker.chattering(file, amplitude),
            "action_rate",
            "worse beyond tolerance",
            None,
        ),
        (
            "80 %, backward only",
            lambda file: walker.slowed(file, 0.8, only_backward=True),
            "vx_reached",
            "worse beyond tolerance",
            None,
        ),
        ("falls once in 50", lambda file: walker.falling(file, 0.02), "falls", "worse beyond tolerance", 48),
    ):
        begin = perf_counter()
        candidate = field.judge(make(tmp_path / f"{len(rows)}" / "exported" / "policy.onnx"), seeds)
        rows.append(table_row(robot, name, candidate, metric, perf_counter() - begin))
        assert rows[-1][2] == verdict
        assert candidate.passed is (verdict == "worse within tolerance")
    begin = perf_counter()
    alarms = field.alarms(20)
    rows.append(
        (robot, "itself, 20 x other seeds", f"{len(alarms)} alarms", "", "", "", f"{perf_counter() - begin:.0f}")
    )
    assert alarms == []
