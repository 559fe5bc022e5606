"""Episodes: functions of policy, case and seed alone, measured as anybody else would measure them."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec.structs import replace
from policies import SAMPLE, WALKER, failing_copy
from regress_runs import standing_policy, yaml_suite

from humanoid_sim.evaluation.tracking import TrackingErrors
from humanoid_sim.regress.episodes import Step, episode_keys, run_episodes
from humanoid_sim.regress.metrics import METRICS, VelocityMeasures
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import Case, Disturbance, Pushes, Suite, Tolerance, load_suite
from humanoid_sim.simulation.batch import Randomisation

QUIET = Disturbance(Randomisation())


def make(folder, policy=SAMPLE):
    """The first case of the short suite with a policy."""
    suite, where = load_suite(str(yaml_suite(folder)))
    return prepare_policy(prepare_suite(suite, where), policy).cases[0]


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return make(tmp_path_factory.mktemp("suite"))


def test_an_episode_is_the_same_in_any_company(short):
    together = run_episodes(short, [0, 1, 2, 3, 7], short.suite.disturbance, threads=2)
    alone = run_episodes(short, [3], short.suite.disturbance, threads=1)
    others = run_episodes(short, [7, 3, 0], short.suite.disturbance)
    assert alone[0] == together[3] == others[1]
    assert others[0] == together[4]
    assert len({episode.metrics["joint_error"] for episode in together}) == 5


def test_cases_and_seeds_draw_their_own():
    keys = {int(key) for case in ("wave", "drum") for key in episode_keys(case, range(5))}
    assert len(keys) == 10
    assert episode_keys("wave", [3]) == episode_keys("wave", range(5))[3:4]


def test_what_an_episode_says_of_itself(short):
    (episode,) = run_episodes(short, [5], short.suite.disturbance)
    assert (episode.case, episode.seed, episode.steps, episode.failure, episode.kind) == ("wave", 5, 20, "", "")
    assert episode.duration == pytest.approx(0.4)
    assert list(episode.metrics) == list(METRICS["tracking"])
    assert episode.metrics["survival"] == 1.0
    assert (episode.metrics["faults"], episode.metrics["losses"]) == (0.0, 0.0)


def test_body_errors_are_those_of_the_tracking_report(short):
    """Against `TrackingErrors`, which has kinematics of its own, on the states of an undisturbed episode."""
    steps = list[Step]()
    (episode,) = run_episodes(short, [0], QUIET, watch=steps)
    errors = TrackingErrors(
        short.scenario.description, short.motion.frames, short.motion.body_names, short.scenario.contract.policy_dt
    )
    for frame, step in enumerate(steps[1:], start=1):
        errors.update(frame, step.state.joint_position[0])
    summary = errors.summary()
    position = np.sqrt(np.mean([body.position_rms**2 for body in summary.bodies]))
    orientation = np.sqrt(np.mean([body.orientation_rms**2 for body in summary.bodies]))
    assert summary.samples == episode.steps == 20
    assert episode.metrics["body_position_error"] == pytest.approx(position, rel=1e-9)
    assert episode.metrics["body_orientation_error"] == pytest.approx(orientation, rel=1e-6)


def test_joint_errors_are_against_the_inverse_kinematics_of_the_motion(short):
    steps = list[Step]()
    (episode,) = run_episodes(short, [0], QUIET, watch=steps)
    reached = np.array([step.state.joint_position[0] for step in steps[1:]])
    expected = np.sqrt(((reached - short.joint_reference[1:21]) ** 2).mean())
    assert episode.metrics["joint_error"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("value", "failure"),
    [
        (np.nan, "action of left_shoulder_pitch is nan, expected a magnitude <= 100"),
        (1e6, "action of left_shoulder_pitch is .*, expected a magnitude <= 100: --action-limit, .*"),
    ],
)
def test_actions_that_the_controller_refuses_are_counted(tmp_path, value, failure):
    case = make(tmp_path, failing_copy(SAMPLE, tmp_path / "bad.onnx", value))
    episodes = run_episodes(case, [0, 1], case.suite.disturbance)
    for episode in episodes:
        assert re.fullmatch(failure, episode.failure)
        assert (episode.kind, episode.steps) == ("fault", 0)
        assert (episode.metrics["faults"], episode.metrics["survival"]) == (1.0, 0.0)
        assert episode.metrics["joint_error"] is None


STANDING = Suite(
    name="standing",
    task="velocity",
    robot="lite_biped",
    cases=(Case(name="stand", command=(0.0, 0.0, 0.0), duration=1.0),),
    seeds=2,
    settle=0.5,
    tolerances={"falls": Tolerance()},
)


@pytest.fixture(scope="module")
def standing(tmp_path_factory):
    folder = tmp_path_factory.mktemp("standing")
    return prepare_policy(prepare_suite(STANDING, folder), standing_policy(folder / "standing.onnx")).cases[0]


def test_errors_are_against_the_command(standing):
    """The robot stands: what it is told is what it misses."""
    case = Case(name="go", command=(0.6, 0.8, -0.7), duration=1.0)
    (episode,) = run_episodes(dataclasses.replace(standing, case=case), [0], QUIET)
    assert episode.metrics["velocity_error"] == pytest.approx(1.0, abs=0.05)
    assert episode.metrics["yaw_rate_error"] == pytest.approx(0.7, abs=0.05)
    for name in ("vx_reached", "vy_reached", "yaw_rate_reached"):
        assert episode.metrics[name] == pytest.approx(0.0, abs=0.05)


def test_a_velocity_is_averaged_over_a_second():
    """A robot that starts late is wrong until a second after it has the speed asked for."""
    measures = VelocityMeasures(SimpleNamespace(contract=SimpleNamespace(policy_dt=0.02)), None, 0.0, 200, 1)
    measures._command, measures._velocity[:] = np.array([[0.5, 0.0, 0.0]]), 0.0
    measures._velocity[50:, 0, 0] = 0.5
    error = measures.step_values()["velocity_error"][:, 0]
    assert error[[49, 74, 99, 199]].tolist() == pytest.approx([0.5, 0.25, 0.0, 0.0])


def test_a_speed_is_reached_along_the_axes_that_are_commanded(standing):
    """Against the way that the base went; a command too small to divide by asks for no speed."""
    suite = replace(STANDING, cases=(Case(name="go", command=(0.5, 0.0, 0.05), duration=3.0),), settle=1.5)
    (case,) = prepare_policy(prepare_suite(suite, WALKER.path.parent), WALKER.path).cases
    steps = list[Step]()
    (episode,) = run_episodes(case, [0], QUIET, watch=steps)
    assert (episode.metrics["vy_reached"], episode.metrics["yaw_rate_reached"]) == (None, None)
    start, end = steps[75].qpos[0], steps[-1].qpos[0]
    w, _, _, z = steps[112].qpos[0, 3:7]  # half way
    heading = np.array([w * w - z * z, 2.0 * w * z])
    assert episode.metrics["vx_reached"] == pytest.approx(heading @ (end - start)[:2] / 1.5 / 0.5, rel=0.03)
    assert 0.6 < episode.metrics["vx_reached"] < 1.0
    faster = dataclasses.replace(case, case=replace(case.case, command=(0.11, 0.0, 0.0)))
    (episode,) = run_episodes(faster, [0], Disturbance(Randomisation(), Pushes(speed=0.3, interval=0.5)))
    assert episode.metrics["vx_reached"] is None or episode.metrics["vx_reached"] <= 1.0


def test_a_push_moves_the_base_and_a_hard_one_topples_it(standing):
    still, pushed, toppled = (
        run_episodes(standing, [4], Disturbance(Randomisation(), pushes))[0]
        for pushes in (None, Pushes(speed=0.1, interval=0.4), Pushes(speed=3.0, interval=0.4))
    )
    assert still.metrics["tilt"] is not None
    assert pushed.metrics["tilt"] is not None
    assert pushed.metrics["tilt"] > still.metrics["tilt"]
    assert toppled.kind == "lost"
    assert toppled.failure.startswith("fell: ")
    assert toppled.metrics["falls"] == 1.0
