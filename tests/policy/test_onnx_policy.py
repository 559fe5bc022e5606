"""Checkpoints as ONNX files: what a model has to be, and how every other one is refused in one line."""

import hashlib
from functools import partial
from pathlib import Path

import models
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.rl_policy import infer
from humanoid_sim.errors import InputError
from humanoid_sim.messages import PolicyStep
from humanoid_sim.policy import onnx_policy
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_header


def test_a_checkpoint_is_loaded_with_all_that_it_says(tmp_path):
    path = models.saved(tmp_path / "policy.onnx")
    checkpoint = load_checkpoint(path)
    assert checkpoint.source == str(path)
    assert checkpoint.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert checkpoint.observation_width == 8
    assert checkpoint.contract.action_joint_names == ("c", "a")
    observation = np.linspace(-1.0, 1.0, 8, dtype=np.float32)
    action = np.asarray(checkpoint.policy(observation, 0))
    assert action.dtype == np.float32
    np.testing.assert_allclose(action, observation @ models.weights(8, 2), rtol=1e-6)
    for shape in ((3, 8), (7,)):  # a vector environment's batch, for one
        with pytest.raises(InputError, match="observation: has shape"):
            checkpoint.policy(np.zeros(shape, dtype=np.float32), 0)


def test_a_graph_that_loops_for_ever_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(onnx_policy, "ONNX_SECONDS", 0.2)
    path = models.saved(tmp_path / "policy.onnx", models.looping_model(9e18))
    with pytest.raises(InputError) as caught:
        load_checkpoint(path)
    assert str(caught.value) == (
        f"{path}: the model fails on an observation of zeros: its graph loops: not done after 0.2 s"
    )


def test_one_that_loops_for_some_observation_is_a_fault_in_that_tick(tmp_path):
    checkpoint = load_checkpoint(models.saved(tmp_path / "policy.onnx", models.looping_model(1.0, 9e18)))
    checkpoint.limit_inference(0.1)
    wiring = PolicyWiring(models.JOINTS, checkpoint.contract, no_reference(), {}, 100.0)
    step = infer(wiring, checkpoint.policy, np.ones(8, dtype=np.float32), 0)
    assert isinstance(step, Fault)
    assert step.message == "policy failed: its graph loops: not done after 0.1 s"
    assert isinstance(infer(wiring, checkpoint.policy, np.zeros(8, dtype=np.float32), 0), PolicyStep)


def refusal(path, load=load_checkpoint):
    with pytest.raises(InputError) as caught:
        load(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")
    return text.removeprefix(f"{path}: ")


def of_inputs(*names, outputs=("action",), shape=(1, 2)):
    """A model that adds up its inputs."""
    made = [helper.make_node("Sum", list(names), [output]) for output in outputs]
    ins = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in names]
    outs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in outputs]
    return models.finished(helper.make_graph(made, "policy", ins, outs), None)


def no_output():
    model = models.linear_model()
    del model.graph.output[:]
    return model


def fails_when_it_runs():
    """The declared shapes are right; that it looks up row 99 of 8 shows only when it runs."""
    graph = helper.make_graph(
        [
            helper.make_node("ReduceSum", ["observation"], ["total"], keepdims=0),
            helper.make_node("Cast", ["total"], ["whole"], to=TensorProto.INT64),
            helper.make_node("Add", ["whole", "beyond"], ["row"]),
            helper.make_node("Gather", ["weights", "row"], ["values"]),
            helper.make_node("Reshape", ["values", "form"], ["action"]),
        ],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, 8])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 2])],
        [
            numpy_helper.from_array(models.weights(8, 2), "weights"),
            numpy_helper.from_array(np.array(99), "beyond"),
            numpy_helper.from_array(np.array([1, 2]), "form"),
        ],
    )
    return models.finished(graph, None)


def linear(**form):
    return partial(models.linear_model, **form)


MODELS = {
    "float64": (linear(dtype=TensorProto.DOUBLE), "input 'observation' is tensor(double) of shape [1, 8], expected"),
    "float16": (linear(dtype=TensorProto.FLOAT16), "input 'observation' is tensor(float16) of shape [1, 8], expected"),
    "no batch": (
        linear(input_shape=[8], output_shape=[2]),
        "input 'observation' is tensor(float) of shape [8]",
    ),
    "rank 3": (
        linear(input_shape=[1, 1, 8], output_shape=[1, 1, 2]),
        "input 'observation' is tensor(float) of shape [1, 1, 8], expected",
    ),
    "batch of 4": (
        linear(input_shape=[4, 8], output_shape=[4, 2]),
        "input 'observation' is tensor(float) of shape [4, 8], expected",
    ),
    "width unknown": (linear(input_shape=[1, "n"]), "input 'observation' is tensor(float) of shape [1, 'n'], expected"),
    "wide time step": (partial(of_inputs, "obs", "time_step"), "input 'time_step' is tensor(float) of shape [1, 2], "),
    "two inputs": (partial(of_inputs, "obs", "memory"), "has the inputs obs, memory and 1 outputs, expected one input"),
    "recurrent": (
        partial(of_inputs, "obs", "h_in", "c_in", outputs=("actions", "h_out", "c_out")),
        "is recurrent: its hidden state (h_in, c_in) is not carried",
    ),
    "hidden state": (partial(of_inputs, "obs", "memory", shape=(1, 1, 2)), "is recurrent: "),
    "no output": (
        no_output,
        "has the inputs observation and 0 outputs, expected one input",
    ),
    "output of another width": (
        linear(outputs=3),
        "the model's output is 3 wide, expected 2, one for each of action_joint_names",
    ),
    "no metadata": (partial(models.linear_model, {}), "lacks joint_names, "),
    "fails when it runs": (fails_when_it_runs, "the model fails on an observation of zeros: "),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_model_of_another_form_is_refused_in_one_line(name, tmp_path):
    make, expected = MODELS[name]
    message = refusal(models.saved(tmp_path / "policy.onnx", make()))
    assert message.startswith(expected)


def test_a_leapp_bundle_is_called_that(tmp_path):
    path = models.saved(tmp_path / "walk.onnx", of_inputs("robot_joint_pos", "robot_joint_vel", "last_action_in"))
    (tmp_path / "walk.yaml").write_text("models: {walk: {}}\npipeline: {}\n")
    assert refusal(path).startswith("is a LEAPP bundle, which walk.yaml beside it describes; a graph of 3 inputs")


def _truncated(path):
    models.saved(path)
    path.write_bytes(path.read_bytes()[:-40])


FILES = {
    "missing": (lambda _: None, "no such file, expected an ONNX file"),
    "directory": (Path.mkdir, "is a directory, expected an ONNX file"),
    "empty": (Path.touch, "is empty, expected an ONNX file"),
    "text": (lambda path: path.write_text("a policy"), "is not a"),
    "truncated": (_truncated, "is not a"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_no_model_is_refused_in_one_line(name, tmp_path):
    make, expected = FILES[name]
    path = tmp_path / "policy.onnx"
    make(path)
    for load in (load_checkpoint, read_header):  # with ONNX Runtime, and without
        assert refusal(path, load).startswith(expected)


def with_external_tensors(path):
    onnx.save_model(
        models.linear_model(), str(path), save_as_external_data=True, location=f"{path.name}.data", size_threshold=0
    )
    return path


def test_external_tensors_beside_the_model_are_loaded(tmp_path):
    path = with_external_tensors(tmp_path / "policy.onnx")
    data = tmp_path / "policy.onnx.data"
    assert data.stat().st_size == 8 * 2 * 4
    checkpoint = load_checkpoint(path)
    observation = np.ones(8, dtype=np.float32)
    np.testing.assert_allclose(
        np.asarray(checkpoint.policy(observation, 0)), observation @ models.weights(8, 2), rtol=1e-6
    )
    assert checkpoint.sha256 == hashlib.sha256(path.read_bytes() + data.read_bytes()).hexdigest()
