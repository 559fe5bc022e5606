"""Which policies a running session can take: what the process that proves them finds."""

import json
from dataclasses import replace
from pathlib import Path

import onnx
import pytest

from humanoid_sim.assets import SAMPLE_POLICY, WALKING_POLICY
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import InputError
from humanoid_sim.play import loading
from humanoid_sim.play.loading import Prover, parse_options
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import rebuild_supervisor, recorded_motion, run_header

PERIOD = 0.005


def header(robot="lite", period=PERIOD):
    return run_header(load_robot(robot), period, None, settings={"policy": None}, remote=True, loads=True)


def proved(run, robot="lite", config=None, **options):
    """In this process, which takes no seconds to start."""
    asked = parse_options(json.dumps(options), config or PlayConfig(policy="none", robot=robot))
    return loading._proved(asked, run)


def test_a_policy_is_proved_in_a_process_of_its_own_and_stands_in_the_header():
    config = parse_options('{"policy": "lite_tracking", "motion": "circle"}', PlayConfig(policy="none"))
    found = Prover().prove(config, header())
    assert (found.source, Path(found.motion_file or "").name) == (str(SAMPLE_POLICY), "circle.mcap")
    settings = json.loads(found.header.documents["settings"])
    assert (settings["policy"], settings["options"]["motion"]) == (found.source, "circle")
    assert settings["policy_sha256"] == found.sha256 != ""
    assert "golden vectors: 8 samples" in found.notices[-1]
    assert recorded_motion(found.header) is not None
    controller = rebuild_supervisor(found.header, lambda *_: [0.0]).controllers["rl_policy_controller"]
    assert isinstance(controller, RLPolicyController)
    assert controller.decimation == 4


def test_a_policy_whose_process_dies_is_refused_with_its_status(monkeypatch):
    monkeypatch.setattr(loading, "_PROGRAM", "import os; os.kill(os.getpid(), 11)")
    with pytest.raises(InputError, match=r"^lite_tracking: the process that checked it ended with status -11$"):
        Prover().prove(PlayConfig(policy="lite_tracking"), header())


def test_nothing_is_proved_any_more_when_the_session_ends():
    prover = Prover()
    prover.cancel()
    with pytest.raises(InputError, match=r"^the session ends$"):
        prover.prove(PlayConfig(policy="lite_tracking"), header())


def test_a_policy_for_another_robot_is_refused():
    with pytest.raises(InputError, match=r"^it fits --robot lite_biped; policy on robot 'lite': .* left_knee_pitch"):
        proved(header(), policy="lite_biped_velocity")


def test_a_policy_whose_rate_does_not_divide_is_refused():
    with pytest.raises(InputError, match=r"its policy_dt is 0\.02 s, expected a multiple of .* period, 0\.0125 s"):
        proved(header(period=0.0125), policy="lite_tracking")


def test_a_policy_that_fails_its_golden_vectors_is_refused(tmp_path):
    """One weight is another: the answers are not the trainer's."""
    model = onnx.load(str(SAMPLE_POLICY))
    weight = max(model.graph.initializer, key=lambda tensor: len(tensor.raw_data))
    weight.raw_data = weight.raw_data[:-4] + b"\x00\x00\x80\x41"
    changed = tmp_path / "changed.onnx"
    onnx.save(model, str(changed))
    with pytest.raises(InputError, match=r"changed\.onnx: .*golden"):
        proved(header(), policy=str(changed), motion="wave")


def test_a_policy_that_walks_begins_with_its_command():
    found = proved(header("lite_biped"), "lite_biped", policy="lite_biped_velocity", command="0.3,0,0")
    assert found.source == str(WALKING_POLICY)
    assert found.command.tolist() == [0.3, 0.0, 0.0]
    with pytest.raises(InputError, match=r"^--command: means nothing for this policy"):
        proved(header(), policy="lite_tracking", command="0.3,0,0")


def test_on_hardware_what_nobody_measures_is_refused():
    config = PlayConfig(policy="none", hardware="can0", robot="lite_biped")
    with pytest.raises(InputError, match=r"imu|IMU"):
        proved(header("lite_biped", 0.02), config=config, policy="lite_biped_velocity")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[]", 'expected a JSON object with "policy"'),
        ("{", "its options are no JSON: "),
        ('{"motion": "wave"}', 'expected a JSON object with "policy"'),
        ('{"policy": "x.onnx"}', "--policy: is 'x.onnx', expected an absolute path, or one of lite_biped_velocity, "),
        ('{"policy": "/x.onnx", "contract": "c.yaml"}', "--contract: is 'c.yaml', expected an absolute path"),
        ('{"policy": "/x.onnx", "motion": "m.mcap"}', "--motion: is 'm.mcap', expected an absolute path, or one of "),
        ('{"policy": "/x.onnx", "robot": "lite"}', "'robot': expected texts of policy, contract, motion, song, comm"),
        ('{"policy": "/x.onnx", "command": 3}', "'command': expected texts of "),
        ('{"policy": "/x.onnx", "motion": "wave", "song": "leaps"}', "--motion and --song: both are given"),
    ],
)
def test_a_request_that_is_not_understood_is_refused(text, problem):
    with pytest.raises(InputError) as caught:
        parse_options(text, PlayConfig())
    assert str(caught.value).startswith(problem)


def test_the_options_of_the_policy_before_are_not_those_of_the_next():
    config = PlayConfig(policy="/a.onnx", contract="/a.yaml", motion="wave", command="1,0,0", action_limit=7.0)
    asked = parse_options('{"policy": "/b.onnx"}', config)
    assert (asked.policy, asked.contract, asked.motion, asked.command) == ("/b.onnx", None, None, "0,0,0")
    assert asked.action_limit == 7.0


def test_a_file_that_changes_while_it_is_checked_is_refused():
    found = replace(proved(header(), policy="lite_tracking", motion="wave"), sha256="0" * 64)
    with pytest.raises(InputError, match=r"lite_tracking\.onnx: has changed while it was checked$"):
        loading._policy_of(found, PlayConfig())
