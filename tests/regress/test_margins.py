"""Margins: how far a disturbance can be raised."""

import pytest
from policies import SAMPLE
from regress_runs import SHORT, episode, yaml_suite

from humanoid_sim.regress.executors import run_locally
from humanoid_sim.regress.margins import compare_margins, disturbance_at, measure_margins, planned_levels
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.results import Margin
from humanoid_sim.regress.suite import Pushes, Sweep, load_suite
from humanoid_sim.simulation.batch import Randomisation


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    suite, folder = load_suite(str(yaml_suite(tmp_path_factory.mktemp("suite"))))
    return prepare_policy(prepare_suite(suite, folder), SAMPLE).cases


class FailsBeyond:
    """Runs nothing: an episode is off by as much as it is disturbed, and lost beyond a delay or below some gains."""

    def __init__(self):
        self.ran = []

    def __call__(self, cases, seeds, disturbance, advance):
        self.ran += [(case.case.name, tuple(seeds)) for case in cases]
        return [self._episode(case, seed, disturbance) for case in cases for seed in seeds]

    def _episode(self, case, seed, disturbance):
        drawn = disturbance.randomisation
        error = drawn.command_delay[0]
        failure = "fell" if drawn.stiffness[0] < 0.1 and seed == 1 else ""
        return episode(case.case.name, seed, {"body_position_error": None if failure else error}, failure)


def test_a_sweep_ends_where_an_episode_fails_and_is_narrowed_down(short):
    """Delays are tried in whole steps of physics, of half a millisecond."""
    executor, done = FailsBeyond(), list[int]()
    delay, gains = measure_margins(short, executor, done.append)
    assert (delay.axis, delay.unit, delay.nominal, delay.reached_end) == ("delay", "s", 0.0, False)
    assert (delay.limit, delay.fails_at) == (0.02, 0.03)
    assert delay.levels == pytest.approx((0.01, 0.02, 0.03, 0.04, 0.06, 0.1))
    assert delay.failed_share == (0.0, 0.0, 1.0, 1.0, 1.0, 1.0)
    assert delay.failure == "wave, seed 0: body position error is 30 mm, accepted up to 20 mm"
    assert (gains.axis, gains.limit) == ("gains down", 0.1325)
    assert gains.fails_at == pytest.approx(0.07125)
    assert gains.levels == pytest.approx((0.5, 0.255, 0.1325, 0.07125, 0.01))
    assert gains.failed_share == (0.0, 0.0, 0.0, 0.5, 0.5)
    assert gains.failure == "wave, seed 1: fell"
    assert done == [6, 5]
    assert sum(done) == planned_levels(short[0].suite)
    assert set(executor.ran) == {("wave", (0, 1))}


def test_a_sweep_is_not_halved_below_a_step_of_physics(tmp_path):
    text = SHORT.replace("[0.01, 0.02, 0.1]", "[0.02, 0.021]").replace("margins:\n", "margins:\n  bisections: 9\n")
    suite, folder = load_suite(str(yaml_suite(tmp_path, text)))
    cases = prepare_policy(prepare_suite(suite, folder), SAMPLE).cases
    delay, _ = measure_margins(cases, FailsBeyond(), lambda _: None)
    assert delay.levels == pytest.approx((0.02, 0.0205, 0.021))


def test_a_sweep_that_nothing_fails_in_says_so(short):
    class Fine(FailsBeyond):
        def _episode(self, case, seed, disturbance):
            return episode(case.case.name, seed, {"body_position_error": 0.001})

    delay, _ = measure_margins(short, Fine(), lambda _: None)
    assert (delay.limit, delay.reached_end, delay.failure) == (0.1, True, "")


def test_the_lite_bears_some_delay_and_no_gains_at_all(short):
    delay, gains = measure_margins(short, run_locally, lambda _: None)
    assert delay.limit >= 0.02
    assert 0.01 < gains.limit <= 0.5
    assert gains.limit - gains.fails_at == pytest.approx(0.49 / 8)
    assert not gains.reached_end


@pytest.mark.parametrize(
    ("axis", "level", "expected"),
    [
        ("delay", 0.02, Randomisation(command_delay=(0.02, 0.02))),
        ("jitter", 0.0149, Randomisation(command_jitter=0.014)),
        ("gains", 0.5, Randomisation(stiffness=(0.5, 0.5), damping=(0.5, 0.5))),
        ("friction", 0.3, Randomisation(friction=(0.3, 0.3))),
        ("joint_friction", 2.0, Randomisation(joint_friction=(2.0, 2.0))),
        ("mass", 1.5, Randomisation(mass=(1.5, 1.5))),
        (
            "noise",
            0.01,
            Randomisation(
                joint_position_noise=0.01, orientation_noise=0.01, joint_velocity_noise=0.1, angular_velocity_noise=0.1
            ),
        ),
    ],
)
def test_each_axis_disturbs_one_thing(axis, level, expected):
    disturbance = disturbance_at(Sweep(axis=axis, levels=(level,)), level, Pushes(speed=1.0), 0.002)
    assert (disturbance.randomisation, disturbance.pushes) == (expected, None)


def test_pushes_keep_the_suites_interval():
    sweep = Sweep(axis="push", levels=(0.5,))
    assert disturbance_at(sweep, 0.5, Pushes(speed=0.2, interval=2.5), 0.002).pushes == Pushes(speed=0.5, interval=2.5)
    assert disturbance_at(sweep, 0.5, None, 0.002).pushes == Pushes(speed=0.5)


def margin(limit, fails_at):
    levels = (limit,) if fails_at is None else (limit, fails_at)
    return Margin(axis="delay", unit="s", nominal=0.0, limit=limit, reached_end=fails_at is None, levels=levels)


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [
        ((0.10, 0.11), (0.07, 0.08), "worse beyond tolerance"),
        ((0.10, 0.11), (0.08, 0.09), "within tolerance"),
        ((0.10, None), (0.07, 0.08), "worse beyond tolerance"),
        ((0.10, 0.11), (0.10, 0.11), "within tolerance"),
        ((0.10, 0.11), (0.10, None), "within tolerance"),
        ((0.10, 0.11), (0.13, 0.14), "better"),
        ((0.0, 0.01), (0.10, 0.11), "better"),
        ((0.0, 0.01), (0.0, 0.001), "within tolerance"),
    ],
)
def test_a_margin_is_worse_where_even_the_level_that_failed_lies_too_far_below(tmp_path, before, after, verdict):
    """15 % less is tolerated."""
    suite, _ = load_suite(str(yaml_suite(tmp_path)))
    (comparison,) = compare_margins(suite, [margin(*before)], [margin(*after)])
    assert (comparison.axis, comparison.unit, comparison.verdict) == ("delay", "s", verdict)
    assert (comparison.baseline, comparison.candidate) == (before[0], after[0])
