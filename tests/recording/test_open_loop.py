"""`replay --policy`: what another policy would have commanded on the recorded states."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import onnx
import onnxruntime  # noqa: F401 - here, because its first import opens a file for good
import pytest
from onnx import TensorProto, helper, numpy_helper
from recorded_run import PERIOD, run
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import file_digest, load_checkpoint, placeholder_checkpoint
from humanoid_sim.policy.readers.own import write_metadata
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.replay import main as replay_main
from humanoid_sim.robots.description import load_robot

LITE = load_robot("lite")
CONTRACT = placeholder_checkpoint(LITE, policy_dt=2 * PERIOD).contract
JOINT = 5

replay = partial(run_program, replay_main)


def save_model(path, factors, contract=CONTRACT, width=42):
    """`factors · tanh(joint states · weight)` for the Lite; it does not see its own last action."""
    weight = np.zeros((width, 14), dtype=np.float32)
    weight[:28] = 0.1 * np.random.default_rng(0).normal(size=(28, 14))
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", ["obs", "weight"], ["product"]),
            helper.make_node("Tanh", ["product"], ["bounded"]),
            helper.make_node("Mul", ["bounded", "factors"], ["action"]),
        ],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, width])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 14])],
        [numpy_helper.from_array(weight, "weight"), numpy_helper.from_array(np.float32(factors), "factors")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, write_metadata(contract))
    onnx.save(model, str(path))
    return str(path)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run of a model: the recording and the model."""
    folder = tmp_path_factory.mktemp("run")
    model = save_model(folder / "policy.onnx", np.ones(14))
    ran = {"policy": model, "policy_sha256": file_digest(Path(model))}
    header, ticks = run(load_checkpoint(Path(model)).policy, ran)
    write_recording(folder / "run.mcap", ticks, header)
    return str(folder / "run.mcap"), model


def test_the_recorded_policy_gives_the_recorded_commands_to_the_bit(recorded, capsys):
    path, model = recorded
    assert replay([path, "--policy", model, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["ticks"], result["failure"]) == (320, "")
    for joint in result["joints"]:
        figures = {name: value for name, value in joint.items() if name not in ("joint", "first_time")}
        assert set(figures.values()) == {0.0}, joint
        assert joint["first_time"] is None


def test_a_flipped_sign_is_named_by_its_joint_with_its_size(recorded, tmp_path, capsys):
    factors = np.ones(14)
    factors[JOINT] = -1.0
    other = save_model(tmp_path / "other.onnx", factors)
    assert replay([recorded[0], "--policy", other, "--json"]) == 1
    joints = json.loads(capsys.readouterr().out)["joints"]
    assert [joint["joint"] for joint in joints if joint["position"]] == [LITE.joint_names[JOINT]]
    found = joints[JOINT]
    assert found["first_time"] == pytest.approx(4.2)
    outputs = [tick.output for tick in open_recording(recorded[0]).ticks() if tick.output.policy_step]
    answered = np.abs([output.policy_step.action[JOINT] for output in outputs])
    assert found["position"] == pytest.approx(2.0 * CONTRACT.action_scale[JOINT] * answered.max())
    assert found["torque"] == pytest.approx(outputs[0].command.stiffness[JOINT] * found["position"])
    assert replay([recorded[0], "--policy", other]) == 1
    assert "the commands differ" in capsys.readouterr().out


def test_a_policy_that_answers_nan_is_reported(recorded, tmp_path, capsys):
    factors = np.ones(14)
    factors[JOINT] = np.nan
    other = save_model(tmp_path / "nan.onnx", factors)
    assert replay([recorded[0], "--policy", other]) == 1
    out = capsys.readouterr().out
    assert f"ended at 4.200 s: action of {LITE.joint_names[JOINT]} is nan" in out


def test_what_the_recording_lacks_is_one_line(recorded, tmp_path, capsys):
    walking = replace(CONTRACT, observation=(*CONTRACT.observation, "base_lin_vel"))
    for policy, line in (
        ("lite_biped_velocity", "joint_names of the policy do not match the robot's joints"),
        ("lite_tracking", "is a tracking policy and follows a motion; "),
        (save_model(tmp_path / "walks.onnx", np.ones(14), walking, 45), "observation term 'base_lin_vel' needs"),
    ):
        assert replay([recorded[0], "--policy", policy]) == 2
        error = capsys.readouterr().err
        assert line in error
        assert error.count("\n") == 1
