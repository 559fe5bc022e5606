"""Episodes: functions of policy, case and seed alone, measured as anybody else would measure them."""

import dataclasses
import re

import numpy as np
import pytest
from msgspec.structs import replace
from regress_runs import WALKER, changed_copy, prepared, yaml_suite

from humanoid_sim.assets import PIANO_POLICY
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.evaluation.step_metrics import key_ratios
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.regress.episodes import episode_keys, run_episodes
from humanoid_sim.regress.preparation import prepare_suite
from humanoid_sim.regress.run import run_seeds
from humanoid_sim.regress.suite import Case, Suite, Tolerance, load_suite
from humanoid_sim.simulation.randomisation import Randomisation


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return prepared(yaml_suite(tmp_path_factory.mktemp("suite")))


@pytest.fixture
def samples(monkeypatch):
    """Every policy step of the episodes of a test, as they are measured."""
    found, sampled = [], ClosedLoop.sample

    def watched(loop, step):
        found.append(sampled(loop, step))
        return found[-1]

    monkeypatch.setattr(ClosedLoop, "sample", watched)
    return found


def test_an_episode_is_the_same_in_any_company_and_every_time(short):
    together = run_episodes(short, [0, 1, 2, 3, 7], threads=2)
    others = run_episodes(short, [7, 3, 0], threads=1)
    assert run_episodes(short, [3]) == [together[3]] == others[1:2]
    assert others[0] == together[4]
    assert len({episode.metrics["body_position_error"] for episode in together}) == 5
    keys = {int(key) for case in ("wave", "drum") for key in episode_keys(case, range(5))}
    assert len(keys) == 10, "no two cases share their draws"


def test_a_worker_of_a_cluster_gives_the_same_episodes(tmp_path):
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    policy = changed_copy(tmp_path / "other.onnx", "Add", np.full(1, 0.05, dtype=np.float32))
    one = replace(suite, cases=suite.cases[1:])
    parcel = prepare_suite(suite, folder), policy, None
    assert run_seeds(parcel, 1, [2, 0]) == run_episodes(prepared(one, policy), [2, 0])


@pytest.mark.parametrize(("value", "said"), [(np.nan, "nan"), (1e6, ".*")])
def test_actions_that_the_controller_refuses_are_counted_and_end_nothing_else(tmp_path, value, said):
    bad = changed_copy(tmp_path / "bad.onnx", "Add", np.array([value], dtype=np.float32))
    for episode in run_episodes(prepared(yaml_suite(tmp_path), bad), [0, 1]):
        assert re.match(f"action of left_shoulder_pitch is {said}, expected a magnitude <= 100", episode.failure)
        assert (episode.kind, episode.steps) == ("fault", 0)
        assert [episode.metrics[name] for name in ("faults", "survival", "effort")] == [1.0, 0.0, None]


def test_a_model_that_raises_for_one_robot_ends_that_episode_alone(short):
    def policy(observation, frame):
        calls.append(frame)
        if len(calls) == 2:
            raise RuntimeError
        return np.zeros(14, dtype=np.float32)

    calls = []
    case = dataclasses.replace(short, scenario=dataclasses.replace(short.scenario, policy=policy))
    assert [episode.kind for episode in run_episodes(case, [0, 1, 2])] == ["", "fault", ""]


WALK = Suite(
    name="walk",
    task="velocity",
    robot="lite_biped",
    cases=(Case(name="go", command=(0.5, 0.0, 0.05), duration=2.5),),
    seeds=6,
    settle=1.0,
    tolerances={"falls": Tolerance()},
)


@pytest.fixture(scope="module")
def walk():
    return prepared(WALK, WALKER)


def test_a_speed_is_reached_along_the_axes_that_are_commanded(walk, samples):
    """Against the velocities that the base had: over all, and over the last second."""
    (episode,) = run_episodes(walk, [0])
    assert (episode.metrics["vy_reached"], episode.metrics["yaw_rate_reached"]) == (None, None)
    velocity = np.array([sample.base.planar_velocity[0] for sample in samples])
    assert episode.metrics["vx_reached"] == pytest.approx(velocity[50:, 0].mean() / 0.5)
    assert 0.6 < episode.metrics["vx_reached"] < 1.0
    windows = np.array([velocity[max(k - 49, 0) : k + 1].mean(axis=0) for k in range(50, 125)])
    off = np.hypot(windows[:, 0] - 0.5, windows[:, 1])
    assert episode.metrics["velocity_error"] == pytest.approx(off.mean())
    assert episode.metrics["yaw_rate_error"] == pytest.approx(np.abs(windows[:, 2] - 0.05).mean())


def test_a_hard_push_topples_the_robot_which_then_has_no_errors(walk):
    pushed = replace(WALK, randomisation=Randomisation(push=(3.0, 3.0), push_interval=0.8))
    (episode,) = run_episodes(dataclasses.replace(walk, suite=pushed), [4])
    assert episode.kind == "lost"
    assert episode.failure.startswith("fell: ")
    assert [episode.metrics[name] for name in ("falls", "tilt")] == [1.0, None]


def test_a_song_is_scored_as_a_run_is(samples):
    songs = Suite(
        name="songs",
        task="piano",
        robot="lite_piano",
        cases=(Case(name="five", song="five_fingers", duration=2.0),),
        seeds=6,
        tolerances={"f1": Tolerance()},
        implicit=True,
    )
    case = prepared(songs, PIANO_POLICY)
    (episode,) = run_episodes(case, [0], threads=1)
    pressed = np.stack([sample.state.extern[KEY_PRESSED].value[0] for sample in samples])
    wanted = case.scenario.motion.frames[1:101] > 0.5
    for name, ratios in zip(("precision", "recall", "f1"), key_ratios(pressed > 0.5, wanted), strict=True):
        assert episode.metrics[name] == pytest.approx(ratios.mean())
    assert 1.0 < episode.metrics["key_force"] < 14.0
    assert episode.metrics["hard_touches"] == 0.0
