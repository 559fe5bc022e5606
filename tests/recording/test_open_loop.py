"""`replay --policy`: what another policy would have commanded on the recorded states."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import onnxruntime  # noqa: F401 - here, because its first import opens a file for good
import pytest
from models import linear_model, saved
from recorded_run import PERIOD, run
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import load_checkpoint, placeholder_checkpoint
from humanoid_sim.policy.readers.own import write_metadata
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.replay import main as replay_main
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
CONTRACT = placeholder_checkpoint(LITE, policy_dt=2 * PERIOD).contract
JOINT = 5

replay = partial(run_program, replay_main)


def save_model(path, factor=1.0, contract=CONTRACT, width=42):
    """A linear policy of the Lite's joint states; the answer for one joint is multiplied by a factor."""
    matrix = np.zeros((width, 14))
    matrix[:28] = 0.05 * np.random.default_rng(0).normal(size=(28, 14))
    matrix[:28, JOINT] *= factor
    return saved(path, linear_model(write_metadata(contract), matrix=matrix))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The recording of a run of a model."""
    folder = tmp_path_factory.mktemp("run")
    header, ticks = run(load_checkpoint(save_model(folder / "policy.onnx")).policy)
    write_recording(folder / "run.mcap", ticks, header)
    return str(folder / "run.mcap")


def test_a_flipped_sign_is_named_by_its_joint_with_its_size(recorded, tmp_path, capsys):
    other = str(save_model(tmp_path / "other.onnx", -1.0))
    assert replay([recorded, "--policy", other, "--json"]) == 1
    joints = json.loads(capsys.readouterr().out)["joints"]
    assert [joint["joint"] for joint in joints if joint["position"]] == [LITE.joint_names[JOINT]]
    found = joints[JOINT]
    assert found["first_time"] == pytest.approx(4.2)
    outputs = [tick.output for tick in open_recording(recorded).ticks() if tick.output.policy_step]
    answered = np.abs([output.policy_step.action[JOINT] for output in outputs])
    assert found["position"] == pytest.approx(2.0 * CONTRACT.action_scale[JOINT] * answered.max())
    assert found["torque"] == pytest.approx(outputs[0].command.stiffness[JOINT] * found["position"])
    assert replay([recorded, "--policy", other]) == 1
    assert "the commands differ" in capsys.readouterr().out


def test_a_policy_that_answers_nan_is_reported(recorded, tmp_path, capsys):
    assert replay([recorded, "--policy", str(save_model(tmp_path / "nan.onnx", np.nan))]) == 1
    out = capsys.readouterr().out
    assert f"ended at 4.200 s: action of {LITE.joint_names[JOINT]} is nan" in out


def test_where_no_policy_ran_nothing_is_compared(recorded, tmp_path, capsys):
    recording = open_recording(recorded)
    write_recording(tmp_path / "run.mcap", [*recording.ticks()][:10], recording.header)
    assert replay([str(tmp_path / "run.mcap"), "--policy", str(save_model(tmp_path / "same.onnx"))]) == 1
    assert "nothing to compare: no policy ran" in capsys.readouterr().out


def test_what_the_recording_lacks_is_one_line(recorded, tmp_path, capsys):
    assert replay([recorded, "--contract", "x.yaml"]) == 2
    assert "--contract: is given, expected it with --policy" in capsys.readouterr().err
    walking = replace(CONTRACT, observation=(*CONTRACT.observation, "base_lin_vel"))
    for policy, line in (
        ("lite_biped_velocity", "joint_names of the policy do not match the robot's joints"),
        ("lite_tracking", "is a tracking policy and follows a motion; "),
        (str(save_model(tmp_path / "walks.onnx", 1.0, walking, 45)), "observation term 'base_lin_vel' needs"),
    ):
        assert replay([recorded, "--policy", policy]) == 2
        error = capsys.readouterr().err
        assert line in error
        assert error.count("\n") == 1
