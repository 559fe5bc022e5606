"""Checkpoints as ONNX files: what a model has to be, and how every other one is refused in one line."""

import hashlib

import models
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint


def test_a_checkpoint_is_loaded_with_the_tensors_beside_it(tmp_path):
    path, data = tmp_path / "policy.onnx", tmp_path / "policy.onnx.data"
    onnx.save(models.linear_model(), str(path), save_as_external_data=True, location=data.name, size_threshold=0)
    checkpoint = load_checkpoint(path)
    digest = hashlib.sha256(path.read_bytes() + data.read_bytes()).hexdigest()
    assert (checkpoint.source, checkpoint.sha256) == (str(path), digest)
    assert (checkpoint.observation_width, checkpoint.contract.action_joint_names) == (8, ("c", "a"))
    observation = np.linspace(-1.0, 1.0, 8, dtype=np.float32)
    action = np.asarray(checkpoint.policy(observation, 0))
    assert action.dtype == np.float32
    np.testing.assert_allclose(action, observation @ models.weights(8, 2), rtol=1e-6)


def of_inputs(*names, outputs=("action",), shape=(1, 2)):
    """A model that adds up its inputs."""
    made = [helper.make_node("Sum", list(names), [output]) for output in outputs]
    ins = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in names]
    outs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in outputs]
    return models.finished(helper.make_graph(made, "policy", ins, outs), None)


def fails_when_it_runs():
    """The shapes are right; that it looks up value 99 of 8 shows only when it runs."""
    graph = helper.make_graph(
        [helper.make_node("Gather", ["observation", "places"], ["action"], axis=1)],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, 8])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 2])],
        [helper.make_tensor("places", TensorProto.INT64, [2], [0, 99])],
    )
    return models.finished(graph, None)


def without_inputs():
    """It answers the same always."""
    outs = [helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 2])]
    made = [helper.make_node("Constant", [], ["action"], value_floats=[0.0, 1.0])]
    return models.finished(helper.make_graph(made, "policy", [], outs), None)


linear = models.linear_model
MODELS = [
    (linear(dtype=TensorProto.DOUBLE), "input 'observation' is tensor(double) of shape [1, 8], expected"),
    (linear(input_shape=[8], output_shape=[2]), "input 'observation' is tensor(float) of shape [8]"),
    (linear(input_shape=[4, 8], output_shape=[4, 2]), "input 'observation' is tensor(float) of shape [4, 8], expected"),
    (linear(input_shape=[1, "n"]), "input 'observation' is tensor(float) of shape [1, 'n'], expected"),
    (of_inputs("obs", "memory"), "has the inputs obs, memory, expected one observation"),
    (
        of_inputs("obs", "hidden_states", outputs=("actions", "new_states")),
        "is recurrent, or has a second observation: beside obs it has hidden_states,",
    ),
    (
        of_inputs("obs", "h_in", "c_in", outputs=("actions", "h_out", "c_out")),
        "is recurrent: its hidden state (h_in, c_in) is not carried",
    ),
    (without_inputs(), "has the inputs none, expected one observation"),
    (linear(outputs=3), "the model's output is 3 wide, expected 2"),
    (linear(metadata={}), "lacks joint_names, "),
    (fails_when_it_runs(), "the model fails on an observation of zeros: "),
]


@pytest.mark.parametrize(("model", "expected"), MODELS, ids=[expected for _, expected in MODELS])
def test_a_model_of_another_form_is_refused_in_one_line(model, expected, tmp_path):
    path = models.saved(tmp_path / "policy.onnx", model)
    with pytest.raises(InputError) as caught:
        load_checkpoint(path)
    assert str(caught.value).startswith(f"{path}: {expected}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("name", "start"), [("policy.pt", b"?"), ("policy.onnx", b"PK\3\4"), ("policy.onnx", b"")])
def test_what_pytorch_saved_is_no_onnx_file_by_any_name(tmp_path, name, start):
    (tmp_path / name).write_bytes(start)
    with pytest.raises(InputError, match=rf"{name}: is no ONNX file: export"):
        load_checkpoint(tmp_path / name)


def test_a_newer_format_is_refused_with_both_versions_alone(tmp_path):
    model = models.linear_model()
    model.ir_version = 99
    with pytest.raises(InputError, match=r"policy.onnx: .* can load: Unsupported model IR version: 99, max supported"):
        load_checkpoint(models.saved(tmp_path / "policy.onnx", model))
