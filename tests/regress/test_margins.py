"""Margins: how far a disturbance can be raised."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from policies import SAMPLE
from regress_runs import episode, yaml_suite

from humanoid_sim.regress.compare import compare_margins
from humanoid_sim.regress.executors import Advance, LocalExecutor
from humanoid_sim.regress.margins import disturbance_at, measure_margins
from humanoid_sim.regress.preparation import PreparedCase, prepare_policy, prepare_suite
from humanoid_sim.regress.results import Episode, Margin
from humanoid_sim.regress.suite import Disturbance, Pushes, Sweep
from humanoid_sim.regress.suite_file import load_suite
from humanoid_sim.simulation.batch import Randomisation


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[PreparedCase, ...]:
    suite, folder = load_suite(str(yaml_suite(tmp_path_factory.mktemp("suite"))))
    return prepare_policy(prepare_suite(suite, folder), SAMPLE).cases


class FailsBeyond:
    """Runs nothing: an episode is off by as much as it is disturbed, and lost beyond a delay or below some gains."""

    def __init__(self) -> None:
        self.ran: list[tuple[str, tuple[int, ...]]] = []

    def run(
        self, cases: Sequence[PreparedCase], seeds: Sequence[int], disturbance: Disturbance, advance: Advance
    ) -> list[Episode]:
        self.ran += [(case.case.name, tuple(seeds)) for case in cases]
        return [self._episode(case, seed, disturbance) for case in cases for seed in seeds]

    def _episode(self, case: PreparedCase, seed: int, disturbance: Disturbance) -> Episode:
        drawn = disturbance.randomisation
        error = drawn.command_delay[0]
        failure = "fell" if drawn.stiffness[0] < 0.1 and seed == 1 else ""
        return episode(case.case.name, seed, {"body_position_error": None if failure else error}, failure)


def test_a_sweep_ends_where_an_episode_fails(short: tuple[PreparedCase, ...]) -> None:
    executor, done = FailsBeyond(), list[int]()
    delay, gains = measure_margins(short, executor, done.append)
    assert (delay.axis, delay.unit, delay.nominal, delay.limit, delay.reached_end) == ("delay", "s", 0.0, 0.02, False)
    assert delay.levels == (0.01, 0.02, 0.1)
    assert delay.failed_share == (0.0, 0.0, 1.0)
    assert delay.failure == "wave, seed 0: body position error is 100 mm, accepted up to 20 mm"
    assert (gains.axis, gains.limit, gains.failed_share) == ("gains down", 0.5, (0.0, 0.5))
    assert gains.failure == "wave, seed 1: fell"
    assert done == [3, 2]
    assert set(executor.ran) == {("wave", (0, 1))}


def test_a_sweep_that_nothing_fails_in_says_so(short: tuple[PreparedCase, ...]) -> None:
    class Fine(FailsBeyond):
        def _episode(self, case: PreparedCase, seed: int, disturbance: Disturbance) -> Episode:
            return episode(case.case.name, seed, {"body_position_error": 0.001})

    delay, _ = measure_margins(short, Fine(), lambda _: None)
    assert (delay.limit, delay.reached_end, delay.failure) == (0.1, True, "")


def test_the_lite_bears_some_delay_and_no_gains_at_all(short: tuple[PreparedCase, ...]) -> None:
    delay, gains = measure_margins(short, LocalExecutor(), lambda _: None)
    assert delay.limit >= 0.02
    assert gains.limit == 0.5
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
                joint_position_noise=0.01,
                orientation_noise=0.01,
                joint_velocity_noise=0.1,
                angular_velocity_noise=0.1,
            ),
        ),
    ],
)
def test_each_axis_disturbs_one_thing(axis: str, level: float, expected: Randomisation) -> None:
    disturbance = disturbance_at(Sweep(axis=axis, levels=(level,)), level, Pushes(speed=1.0), 0.002)
    assert (disturbance.randomisation, disturbance.pushes) == (expected, None)


def test_pushes_keep_the_suites_interval() -> None:
    sweep = Sweep(axis="push", levels=(0.5,))
    assert disturbance_at(sweep, 0.5, Pushes(speed=0.2, interval=2.5), 0.002).pushes == Pushes(speed=0.5, interval=2.5)
    assert disturbance_at(sweep, 0.5, None, 0.002).pushes == Pushes(speed=0.5)


def margin(limit: float) -> Margin:
    return Margin(axis="delay", unit="s", nominal=0.0, limit=limit, reached_end=False)


@pytest.mark.parametrize(
    ("before", "after", "verdict"),
    [(0.1, 0.01, "worse"), (0.1, 0.02, "same"), (0.02, 0.1, "same"), (0.0, 0.1, "better"), (0.02, 0.02, "same")],
)
def test_one_level_more_or_less_is_the_same(tmp_path: Path, before: float, after: float, verdict: str) -> None:
    suite, _ = load_suite(str(yaml_suite(tmp_path)))
    (comparison,) = compare_margins(suite, [margin(before)], [margin(after)])
    assert (comparison.axis, comparison.verdict) == ("delay", verdict)
