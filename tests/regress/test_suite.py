"""Suites: one clear line for whatever is wrong with one, and baselines that fit them."""

from hashlib import sha256

import pytest
from regress_runs import SAMPLE, SHORT, WALKER, prepared, yaml_suite

from humanoid_sim.assets import PIANO_POLICY, asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.regress import main
from humanoid_sim.regress.preparation import prepare_suite
from humanoid_sim.regress.run import stored_baseline
from humanoid_sim.regress.suite import Case, Suite, load_suite

SHIPPED = {
    "velocity.lite_biped.json": ("velocity", "lite_biped", WALKER, 96, 6),
    "lite_piano.json": ("lite_piano", None, PIANO_POLICY, 32, 0),
}


def test_a_suite_of_ones_own(tmp_path):
    suite, folder = load_suite(str(yaml_suite(tmp_path)))
    assert folder == tmp_path.resolve()
    assert [metric.name for metric in suite.metrics] == ["body_position_error", "effort", "losses", "faults"]
    assert suite.tolerance("effort", -2.0) == pytest.approx(0.1)
    assert suite.tolerance("losses", 0.5) == 0.01
    assert suite.tolerance("faults", 0.5) == 0.0


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("task: tracking", "task: drums", "task: is 'drums', expected piano"),
        ("name: drum", "name: wave", "cases: are named wave, wave, expected"),
        ("duration: 0.2", "duration: -1", "cases[0].duration: is -1, expected `float` > 0.0"),
        ("motion: wave", "command: [1, 0, 0]", "cases[0]: gives command, expected a motion"),
        ("duration: 0.2", "duration: .inf", "cases[0].duration: is inf, expected a finite"),
        ("{relative: 0.05}", "{relative: 5}", "relative: Expected `float` <= 1.0"),
        ("effort:", "elbow_error:", "tolerances: unknown metric 'elbow_error'"),
        ("{relative: 0.05}", "{relative: -1}", "relative: Expected `float` >= 0.0"),
        ("mass: [0.9, 1.1]", "weight: [1, 1]", "unknown field 'weight'"),
    ],
)
def test_a_bad_suite_is_one_line(tmp_path, before, after, message):
    """The short suite with something in another's place; with nothing before: this and nothing else."""
    path = yaml_suite(tmp_path, SHORT.replace(before, after) if before else after)
    with pytest.raises(InputError) as error:
        load_suite(str(path))
    assert str(error.value).startswith(f"{path}: ")
    assert message in str(error.value)


def song(name):
    return Suite(
        name="songs", task="piano", robot="lite_piano", cases=(Case(name="a", song=name),), seeds=6, tolerances={}
    )


@pytest.mark.parametrize(
    ("suite", "robot", "policy", "message"),
    [
        ("velocity", None, WALKER, "--robot: is missing; the suite 'velocity' is for any robot"),
        ("velocity", "lite_biped", SAMPLE, "is a policy for task_type tracking, the suite 'velocity' is for velocity"),
        ("lite_tracking", "lite_neck", SAMPLE, "the policy lacks neck_yaw, neck_roll, neck_pitch"),
        (song("nothing"), None, PIANO_POLICY, "case 'a': song: unknown song 'nothing'; known: black"),
    ],
)
def test_what_does_not_fit_is_one_line(suite, robot, policy, message):
    with pytest.raises(InputError) as error:
        prepared(suite if isinstance(suite, Suite) else load_suite(suite)[0], policy, robot)
    assert message in str(error.value)


def test_a_digest_knows_what_is_run_and_no_names(tmp_path):
    (tmp_path / "mine.mid").write_bytes(asset_path("songs", "twinkle.mid").read_bytes())
    digests = [prepare_suite(song(name), tmp_path).digests["a"] for name in ("twinkle", "mine.mid", "repeats")]
    assert digests[0] == digests[1] != digests[2]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_baselines_are_of_shipped_policies_and_fit_todays_suites(name):
    suite, robot, policy, episodes, failed = SHIPPED[name]
    path = asset_path("suites", name)
    baseline = stored_baseline(prepare_suite(*load_suite(suite), robot), path)
    assert baseline.sha256 == sha256(policy.read_bytes()).hexdigest()
    assert (len(baseline.episodes), len(baseline.failures)) == (episodes, failed)


@pytest.mark.soak
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_policies_pass_against_their_baselines(name, capsys):
    suite, robot, policy, _, _ = SHIPPED[name]
    arguments = ["--suite", suite, "--baseline", str(asset_path("suites", name)), *(["--robot", robot] * bool(robot))]
    assert main([str(policy), *arguments]) == 0
    assert "PASS" in capsys.readouterr().out
