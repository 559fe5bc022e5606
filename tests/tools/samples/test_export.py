import itertools

import numpy as np
import onnx
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.metadata import METADATA_KEYS
from humanoid_sim.policy.onnx_policy import read_header
from tools.samples import scales
from tools.samples.arm import ORIENTATION_SIGN, POSITION_SIGN, arm_joints, both_arms
from tools.samples.export import OBSERVATIONS, export_policy, sample_contract
from tools.samples.motions import BODIES, joint_frames, pose_a

SHIPPED = asset_path("policies", "lite_tracking.onnx")
LAYERS = {"shoulder": (16, 6, 4), "wrist": (9, 5, 3), "feedback": (35, 8, 7)}
ORIGIN = np.array([0.0, 0.09, 0.39])


@pytest.fixture(scope="module")
def weights():
    rng = np.random.default_rng(8)
    found = {}
    for name, widths in LAYERS.items():
        for layer, (inputs, outputs) in enumerate(itertools.pairwise(widths)):
            found[f"{name}.{2 * layer}.weight"] = rng.normal(0.0, 0.3, (outputs, inputs)).astype(np.float32)
            found[f"{name}.{2 * layer}.bias"] = rng.normal(0.0, 0.3, outputs).astype(np.float32)
    return found


def _perceptron(weights, name, value):
    hidden = value @ weights[f"{name}.0.weight"].T + weights[f"{name}.0.bias"]
    return hidden / (1.0 + np.exp(-hidden)) @ weights[f"{name}.2.weight"].T + weights[f"{name}.2.bias"]


def _arm(weights, position, columns, joints, velocity, last):
    """What student.py says, for one left arm, in float64."""
    elbow, hand = (np.column_stack([c, np.cross(c[:, 0], c[:, 1])]) for c in columns)
    shoulder = np.concatenate([(position[0] - ORIGIN) * scales.LENGTH, elbow.ravel(), joints[:4]])
    solution = np.concatenate(
        [_perceptron(weights, "shoulder", shoulder), _perceptron(weights, "wrist", (elbow.T @ hand).ravel())]
    )
    features = [
        solution,
        velocity * scales.VELOCITY,
        (solution * scales.ACTION - joints) * scales.TRACKING,
        (last - solution) * scales.CHANGE,
        (last * scales.ACTION - joints) * scales.LEAD,
    ]
    action = solution + scales.CORRECTION * _perceptron(weights, "feedback", np.concatenate(features))
    largest = np.array(scales.LARGEST_LEAD)
    return (joints + largest * np.tanh((action * scales.ACTION - joints) / largest)) / scales.ACTION


def test_the_graph_computes_what_the_network_is_said_to(tmp_path, lite, weights):
    export_policy(tmp_path / "p.onnx", weights, ORIGIN, sample_contract(lite))
    policy = load_checkpoint(tmp_path / "p.onnx").policy
    rng = np.random.default_rng(9)
    for _ in range(5):
        frame = joint_frames(lite, rng.uniform(-0.5, 0.0, (1, 14)))[0].astype(np.float64)
        joints, velocity, last = 0.3 * rng.normal(size=(3, 14))
        position, columns = frame[:12].reshape(2, 2, 3), frame[12:].reshape(2, 2, 3, 2)
        arms = zip(*(arm_joints(term) for term in (joints, velocity, last)), strict=True)
        (left, right) = arms
        expected = both_arms(
            _arm(weights, position[0], columns[0], *left),
            _arm(weights, position[1] * POSITION_SIGN, columns[1] * ORIENTATION_SIGN, *right),
        )
        observation = np.concatenate([frame, joints, velocity, last]).astype(np.float32)
        np.testing.assert_allclose(policy(observation, 0), expected, atol=1e-5)


def test_the_shipped_policy_describes_itself(lite):
    metadata = read_header(SHIPPED)[0]
    assert set(METADATA_KEYS) <= set(metadata)
    contract = load_checkpoint(SHIPPED).contract
    assert contract.task_type == "tracking"
    assert contract.joint_names == contract.action_joint_names == lite.joint_names
    assert contract.observation_names == OBSERVATIONS
    assert contract.observation_names == ("motion_body_pos_b", "motion_body_ori_b", "joint_pos", "joint_vel", "actions")
    assert contract.body_names == BODIES
    assert contract.policy_dt == 0.02
    np.testing.assert_array_equal(contract.joint_stiffness, 50.0)
    np.testing.assert_array_equal(contract.joint_damping, 2.0)
    np.testing.assert_array_equal(contract.default_joint_pos, pose_a(lite))
    assert metadata["command_names"] == "motion"
    assert metadata["lookahead_steps"] == ""


def test_the_shipped_policy_is_one_small_file_for_old_and_new_runtimes():
    model = onnx.load(str(SHIPPED), load_external_data=False)
    onnx.checker.check_model(model, full_check=True)
    assert SHIPPED.stat().st_size < 2_000_000
    assert not any(tensor.external_data for tensor in model.graph.initializer)
    assert model.opset_import[0].version == 17
    (source,), (sink,) = model.graph.input, model.graph.output
    for tensor, name, width in ((source, "obs", 78), (sink, "actions", 14)):
        batch, values = tensor.type.tensor_type.shape.dim
        assert (tensor.name, batch.dim_param, values.dim_value) == (name, "batch", width)


def test_a_batch_of_the_shipped_policy_is_its_rows_bit_for_bit():
    policy = load_checkpoint(SHIPPED).policy
    observations = np.random.default_rng(11).normal(size=(131, 78)).astype(np.float32)
    alone = np.stack([policy(observation, 0) for observation in observations])
    for size in (1, 2, 3, 4, 5, 8, 13, 64, 131):
        for begin in range(0, len(observations), size):
            part = slice(begin, begin + size)
            (together,) = policy.model.run(["actions"], {"obs": observations[part]})
            assert together.tobytes() == alone[part].tobytes()


def test_the_shipped_policy_treats_both_arms_alike(lite):
    policy = load_checkpoint(SHIPPED).policy
    rng = np.random.default_rng(10)
    left = 0.2 * rng.normal(size=(3, 7))
    frame = joint_frames(lite, pose_a(lite)[None] + both_arms(left[0], left[0]))[0]
    terms = [both_arms(term, term) for term in left]
    action = policy(np.concatenate([frame, *terms]).astype(np.float32), 0)
    one, other = arm_joints(action)
    np.testing.assert_allclose(one, other, atol=1e-4)
    assert np.abs(action).max() < 5.0
