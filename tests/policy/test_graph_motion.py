"""Motions inside a model's graph: read to their end, pauses included, and laid out for the policy."""

import dialects
import models
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.readers.own import STAMP_KEY, encode

JOINTS = models.JOINTS
BODIES = ("pelvis", "torso")


def tables(frames=7, seed=0):
    """A motion of three joints and two bodies, quaternions w x y z."""
    rng = np.random.default_rng(seed)
    quaternions = rng.normal(size=(frames, 2, 4))
    quaternions /= np.sqrt((quaternions**2).sum(axis=-1, keepdims=True))
    return {
        "joint_pos": rng.normal(size=(frames, 3)).astype(np.float32),
        "joint_vel": rng.normal(size=(frames, 3)).astype(np.float32),
        "body_pos_w": rng.normal(size=(frames, 2, 3)).astype(np.float32),
        "body_quat_w": quaternions.astype(np.float32),
    }


def contract(**changes):
    values = {
        "task_type": "tracking",
        "observation": ("motion_command", "motion_anchor_ori_b", "joint_pos"),
        "body_names": BODIES,
        "anchor_body": "torso",
    }
    return models.contract(**{**values, **changes})


def saved(path, motion, made=None, *, clamps=True):
    """A model that answers row `time_step` of each table, like those of whole_body_tracking."""
    frames = len(next(iter(motion.values())))
    nodes = [
        helper.make_node("MatMul", ["obs", "weights"], ["actions"]),
        helper.make_node("Cast", ["time_step"], ["whole"], to=TensorProto.INT64),
        helper.make_node("Reshape", ["whole", "one"], ["asked"]),
        helper.make_node("Min" if clamps else "Identity", ["asked", "last"] if clamps else ["asked"], ["row"]),
    ]
    nodes += [helper.make_node("Gather", [f"{name}_table", "row"], [name]) for name in motion]
    constants = {"weights": models.weights(15, 2), "one": np.array([1]), "last": np.array([frames - 1])}
    constants |= {f"{name}_table": table for name, table in motion.items()}
    graph = helper.make_graph(
        nodes,
        "tracker",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, n]) for name, n in (("obs", 15), ("time_step", 1))],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, [1, 2])]
        + [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, *t.shape[1:]]) for name, t in motion.items()],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = models.finished(graph, {STAMP_KEY: encode(contract() if made is None else made)})
    onnx.save(model, str(path))
    return path


@pytest.mark.parametrize("clamps", [True, False])
def test_a_motion_is_read_as_the_graph_has_it(tmp_path, clamps):
    """To the frame that is held, or to the last that there is."""
    motion = tables()
    checkpoint = load_checkpoint(saved(tmp_path / "t.onnx", motion, clamps=clamps))
    read = checkpoint.motion
    rows = [motion[name].reshape(7, -1) for name in motion]
    assert read.frames.tobytes() == np.concatenate(rows, axis=1).tobytes()
    assert (read.joint_names, read.body_names, read.policy_dt) == (JOINTS, BODIES, 0.02)


def test_a_pause_is_not_the_end(tmp_path):
    motion = {name: np.repeat(table, [1, 1, 130, 1, 1, 60, 1], axis=0) for name, table in tables().items()}
    assert len(load_checkpoint(saved(tmp_path / "t.onnx", motion)).motion.frames) == 195


def test_the_reference_shows_the_anchor_body(tmp_path):
    motion = tables()
    checkpoint = load_checkpoint(saved(tmp_path / "t.onnx", motion))
    reference = load_policy(checkpoint.contract, checkpoint.policy, checkpoint.motion).reference
    assert reference.frame_count == 7
    assert np.array_equal(reference.term("anchor_pos", 3), motion["body_pos_w"][3, 1])
    assert np.array_equal(reference.term("anchor_quat", 3), motion["body_quat_w"][3, 1])
    assert np.array_equal(reference.term("reference_joint_pos", 99), motion["joint_pos"][6])
    assert np.array_equal(reference.term("reference_joint_vel", 2), motion["joint_vel"][2])


def test_a_model_that_gives_the_anchor_alone(tmp_path):
    """holosoma's trackers: the orientation of one body, x y z w as the output's name says."""
    motion = tables()
    alone = {name: motion[name] for name in ("joint_pos", "joint_vel")}
    alone["ref_quat_xyzw"] = motion["body_quat_w"][:, 1, [1, 2, 3, 0]]
    path = saved(tmp_path / "t.onnx", alone)
    model = onnx.load(str(path))
    del model.metadata_props[:]
    onnx.save(model, str(path))
    document = dialects.as_contract_yaml(contract(body_names=()))
    del document["reference_quaternion"]
    (tmp_path / "contract.yaml").write_text(dialects.through_yaml(document))
    checkpoint = load_checkpoint(path)
    assert checkpoint.contract.source["reference_quaternion"] == "assumed (output ref_quat_xyzw)"
    reference = load_policy(checkpoint.contract, checkpoint.policy, checkpoint.motion).reference
    assert np.array_equal(reference.term("anchor_quat", 4), motion["body_quat_w"][4, 1])
    needy = contract(body_names=(), observation=("motion_anchor_pos_b", "joint_pos", "motion_command", "base_ang_vel"))
    (tmp_path / "contract.yaml").unlink()
    with pytest.raises(InputError, match="its model has no output 'ref_pos_xyz'"):
        load_checkpoint(saved(tmp_path / "t.onnx", alone, needy))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body_names": ("pelvis",), "anchor_body": "pelvis"}, "output 'body_pos_w' has 6 values, expected 3"),
        ({"anchor_body": "head"}, "anchor_body is 'head', expected one of body_names: pelvis, torso"),
    ],
)
def test_outputs_that_do_not_fit_are_named(tmp_path, changes, message):
    path = saved(tmp_path / "t.onnx", tables(), contract(**changes))
    with pytest.raises(InputError, match=message):
        load_checkpoint(path)


def test_named_tensors_are_used(tmp_path):
    path = saved(tmp_path / "t.onnx", tables())
    (tmp_path / "contract.yaml").write_text("tensors: {action: torque, observation: obs}\n")
    with pytest.raises(InputError, match="has no output 'torque'; its outputs are actions, joint_pos, joint_vel"):
        load_checkpoint(path)
    (tmp_path / "contract.yaml").write_text("tensors: {action: joint_pos}\n")
    with pytest.raises(InputError, match="the model's output is 3 wide, expected 2"):
        load_checkpoint(path)
