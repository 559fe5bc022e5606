"""A batch of observations gets bit for bit what single ones get, whatever the exporter did to the batch dimension."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from policies import SAMPLE
from published import POLICIES, needs_policies

from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.batched_policy import BatchedPolicy

BATCHES = "in batches"
WEIGHTS = np.random.default_rng(3).standard_normal((6, 4)).astype(np.float32)


def network(tmp_path, nodes, constants=(), *, rows=1, time_step=False, outputs=()):
    """A model of 6 observations and 4 actions from a few operators."""
    inputs = [helper.make_tensor_value_info("obs", TensorProto.FLOAT, [rows, 6])]
    if time_step:
        inputs.append(helper.make_tensor_value_info("time_step", TensorProto.FLOAT, [rows, 1]))
    graph = helper.make_graph(
        [helper.make_node(*node[:3], **node[3]) for node in nodes],
        "network",
        inputs,
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [rows, 4]), *outputs],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in (*constants, ("w", WEIGHTS))],
    )
    path = tmp_path / "network.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), str(path))
    return OnnxPolicy(path)


def check(policy, batching=BATCHES, count=9):
    batched = BatchedPolicy(policy)
    assert batched.batching == batching
    observation = np.random.default_rng(1).standard_normal((count, policy.observation_width)).astype(np.float32)
    frame = np.arange(count)
    alone = np.stack([policy(observation[i], i) for i in range(count)])
    together = batched(observation, frame)
    assert together.shape == (count, policy.action_width)
    assert together.tobytes() == alone.tobytes()
    assert batched(observation[3:4], frame[3:4]).tobytes() == alone[3:4].tobytes()


def test_the_sample_policy_runs_in_batches_as_it_is():
    policy = OnnxPolicy(SAMPLE)
    assert policy.model.inputs[0].shape == ("batch", 78)
    check(policy)


@needs_policies
@pytest.mark.parametrize(
    "path",
    [
        "unitree_g1_velocity_v0/exported/policy.onnx",
        "holosoma_g1_loco/ppo_g1_29dof.onnx",
        "beyondmimic_g1/Waltz.onnx",
        "berkeley_humanoid_lite_biped_50hz/checkpoints/policy_biped_50hz.onnx",
        "playground_berkeley_humanoid/bh_policy.onnx",
    ],
)
def test_published_policies_all_declare_a_batch_of_one_and_run_in_batches(path):
    policy = OnnxPolicy(POLICIES / path)
    assert policy.model.inputs[0].shape[0] == 1
    check(policy)


MATMUL = [("MatMul", ["obs", "w"], ["actions"], {})]


def test_what_the_action_does_not_need_keeps_nothing_from_running_in_batches(tmp_path):
    """A motion's `Reshape` takes one frame and no more."""
    nodes = [*MATMUL, ("Reshape", ["time_step", "row"], ["motion"], {})]
    motion = helper.make_tensor_value_info("motion", TensorProto.FLOAT, [1])
    check(network(tmp_path, nodes, [("row", np.array([1]))], time_step=True, outputs=[motion]))


def test_row_by_row_where_a_batch_would_mix_its_rows(tmp_path):
    """The mean over the first axis is that of one row as exported, and of all rows once the batch is free."""
    nodes = [
        ("ReduceMean", ["obs"], ["mean"], {"axes": [0], "keepdims": 1}),
        ("MatMul", ["mean", "w"], ["actions"], {}),
    ]
    check(network(tmp_path, nodes), "row by row: in a batch its answers differ")


def test_rows_that_raise_are_not_a_number_and_the_others_are_answered(tmp_path):
    """A Gather beyond the table's end raises in ONNX Runtime: at frames 4 and 5 here."""
    nodes = [
        ("Cast", ["time_step"], ["index"], {"to": TensorProto.INT64}),
        ("Gather", ["table", "index"], ["value"], {"axis": 0}),
        ("Squeeze", ["value", "axis_one"], ["scalar"], {}),
        ("MatMul", ["obs", "w"], ["product"], {}),
        ("Add", ["product", "scalar"], ["actions"], {}),
    ]
    constants = [("table", np.ones((68, 1), dtype=np.float32)), ("axis_one", np.array([2]))]
    policy = network(tmp_path, nodes, constants, time_step=True)
    batched = BatchedPolicy(policy)
    actions = batched(np.zeros((3, 6), dtype=np.float32), np.array([67, 68, 3]))
    assert np.isnan(actions).all(axis=1).tolist() == [False, True, False]
    assert actions[2].tolist() == [1.0, 1.0, 1.0, 1.0]
