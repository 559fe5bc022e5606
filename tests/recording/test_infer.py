"""`replay --infer`: the model answers the recorded observations again, and its answers are compared bit by bit."""

import json
from functools import partial

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from recorded_run import PERIOD, run, wobbled
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import file_digest, placeholder_checkpoint
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.policy.readers.own import write_metadata
from humanoid_sim.replay import main as replay_main
from humanoid_sim.robots.description import load_robot

pytest.importorskip("onnxruntime")  # here, because its first import opens a file for good

WIDTH, ACTIONS = 42, 14

replay = partial(run_program, replay_main)


def save_model(path, seed=0, width=WIDTH):
    """`tanh(observation @ weight)` for the Lite."""
    weight = 0.1 * np.random.default_rng(seed).normal(size=(width, ACTIONS)).astype(np.float32)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["obs", "weight"], ["product"]), helper.make_node("Tanh", ["product"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [1, width])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, ACTIONS])],
        [numpy_helper.from_array(weight.astype(np.float32), "weight")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    contract = placeholder_checkpoint(load_robot("lite"), policy_dt=2 * PERIOD).contract
    helper.set_model_props(model, write_metadata(contract))
    onnx.save(model, str(path))
    return path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run of a model: the recording and the model."""
    folder = tmp_path_factory.mktemp("run")
    model = save_model(folder / "policy.onnx")
    header, ticks = run(OnnxPolicy(model), {"policy": str(model), "policy_sha256": file_digest(model)})
    write_recording(folder / "run.mcap", ticks, header)
    return folder / "run.mcap", model


def test_the_same_model_answers_the_same(recorded, capsys):
    path, model = recorded
    assert replay([str(path), "--infer"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("ticks, bit for bit identical")
    assert lines[1].startswith(f"infer: {model}: ")
    assert lines[1].endswith(" actions, bit for bit identical")


def test_another_model_is_named_and_measured(recorded, tmp_path, capsys):
    path, _ = recorded
    other = save_model(tmp_path / "other.onnx", seed=1)
    assert replay([str(path), "--infer", "--policy", str(other)]) == 1
    line = capsys.readouterr().out.splitlines()[1]
    assert line.startswith(f"infer: {other} (another file than the one that was recorded: SHA-256 differs): ")
    assert "actions differ, by at most" in line
    assert "beyond the tolerance of 0.0001; first at tick 210, t = 4.200 s" in line
    assert replay([str(path), "--infer", "--policy", str(other), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)["infer"]
    assert result["same_file"] is False
    assert result["same"] is False
    assert result["differing"] > 0.9 * result["steps"] > 10
    assert 0.0 < result["max_difference"] < 2.0
    assert result["first_tick"] is not None


def test_a_changed_action_is_found_without_the_model_that_made_it(recorded, tmp_path, capsys):
    header, ticks = wobbled()
    write_recording(tmp_path / "wobble.mcap", ticks, header)
    assert replay([str(tmp_path / "wobble.mcap"), "--infer", "--policy", str(recorded[1]), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)["infer"]
    assert result["same_file"] is None
    assert (result["first_tick"], result["differing"]) == (210, 21)
    assert np.isfinite(result["max_difference"])


def test_a_model_that_says_nothing_of_itself_runs_on_the_recorded_contract(recorded, tmp_path, capsys):
    path, model = recorded
    bare = onnx.load(str(model))
    del bare.metadata_props[:]
    onnx.save(bare, str(tmp_path / "bare.onnx"))
    assert replay([str(path), "--infer", "--policy", str(tmp_path / "bare.onnx"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)["infer"]
    assert (result["differing"], result["steps"] > 10) == (0, True)


def nudged(model, path, by):
    """The model with a constant added to its action: another file whose answers are almost the same."""
    graph = onnx.load(str(model))
    graph.graph.initializer.append(numpy_helper.from_array(np.float32([by]), "nudge"))
    graph.graph.node[-1].output[0] = "before"
    graph.graph.node.append(helper.make_node("Add", ["before", "nudge"], ["action"]))
    onnx.save(graph, str(path))
    return str(path)


def test_the_status_says_whether_answers_are_the_same_within_the_tolerance(recorded, tmp_path, capsys):
    path, model = str(recorded[0]), recorded[1]
    near = nudged(model, tmp_path / "near.onnx", 2e-5)
    assert replay([path, "--infer", "--policy", near]) == 0
    assert "160 of 160 actions differ, by at most 2e-05: within the tolerance of 0.0001" in capsys.readouterr().out
    assert replay([path, "--infer", "--policy", near, "--tolerance", "1e-6"]) == 1
    assert "160 beyond the tolerance of 1e-06" in capsys.readouterr().out
    assert replay([path, "--infer", "--policy", near, "--tolerance", "0"]) == 1
    assert replay([path, "--infer", "--policy", nudged(model, tmp_path / "far.onnx", 2e-3)]) == 1
    assert replay([path, "--infer", "--policy", nudged(model, tmp_path / "nan.onnx", np.nan)]) == 1
    capsys.readouterr()
    assert replay([path, "--infer", "--tolerance", "-1"]) == 2
    assert capsys.readouterr().err == "error: --tolerance: is -1, expected a finite number >= 0\n"
