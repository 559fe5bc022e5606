"""Motions inside a model's graph: read to their end, pauses included, and laid out for the policy."""

import dialects
import models
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.checkpoint import load_checkpoint, zero_policy
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, motion_bytes, read_motion

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


def test_a_motion_is_read_as_the_graph_has_it(tmp_path):
    motion = tables()
    checkpoint = load_checkpoint(saved(tmp_path / "t.onnx", motion))
    read = checkpoint.motion
    rows = [motion[name].reshape(7, -1) for name in motion]
    assert read.frames.tobytes() == np.concatenate(rows, axis=1).tobytes()
    assert (read.joint_names, read.body_names, read.policy_dt) == (JOINTS, BODIES, 0.02)


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
    assert checkpoint.contract.provenance["reference_quaternion"] == "assumed (output ref_quat_xyzw)"
    reference = load_policy(checkpoint.contract, checkpoint.policy, checkpoint.motion).reference
    assert np.array_equal(reference.term("anchor_quat", 4), motion["body_quat_w"][4, 1])
    needy = contract(body_names=(), observation=("motion_anchor_pos_b", "joint_pos", "motion_command", "base_ang_vel"))
    (tmp_path / "contract.yaml").unlink()
    with pytest.raises(InputError, match="its model has no output 'ref_pos_xyz'"):
        load_checkpoint(saved(tmp_path / "t.onnx", alone, needy))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body_names": ("pelvis",), "anchor_body": "pelvis"}, "output 'body_quat_w' has 8 values, expected 4"),
        ({"anchor_body": "head"}, "anchor_body is 'head', expected one of body_names: pelvis, torso"),
    ],
)
def test_outputs_that_do_not_fit_are_named(tmp_path, changes, message):
    path = saved(tmp_path / "t.onnx", tables(), contract(**changes))
    with pytest.raises(InputError, match=message):
        load_checkpoint(path)


FILE = {
    "frames": np.arange(2.0 * 20).reshape(2, 20),
    "body_names": BODIES,
    "joint_names": JOINTS,
    "policy_dt": 0.02,
    "layout": "joints_bodies_w",
}


def test_a_motion_file_with_joints_and_world_poses(tmp_path):
    motion = Motion(**FILE, robot="g1")
    (tmp_path / "m.mcap").write_bytes(motion_bytes(motion))
    read = read_motion(tmp_path / "m.mcap")
    assert read.frames.tobytes() == motion.frames.tobytes()
    assert (read.layout, read.joint_names, read.body_names) == ("joints_bodies_w", JOINTS, BODIES)
    loaded = load_policy(contract(joint_names=("c", "a", "b")), zero_policy(2), read)
    assert loaded.reference.term("reference_joint_pos", 0).tolist() == [2.0, 0.0, 1.0]
    assert loaded.reference.term("reference_joint_vel", 0).tolist() == [5.0, 3.0, 4.0]
    assert loaded.reference.term("anchor_pos", 1).tolist() == [29.0, 30.0, 31.0]
    assert loaded.reference.term("anchor_quat", 1).tolist() == [36.0, 37.0, 38.0, 39.0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_names": ("a", "b")}, "20 values per frame, expected 18, that is 2 for each of 2 joints and 7"),
        ({"layout": "joints"}, "layout: is 'joints', expected one of bodies_b, joints_bodies_w"),
    ],
)
def test_a_motion_of_another_form_is_refused(changes, message):
    with pytest.raises(FieldError, match=message):
        Motion(**{**FILE, **changes})


def test_named_tensors_are_used(tmp_path):
    path = saved(tmp_path / "t.onnx", tables())
    (tmp_path / "contract.yaml").write_text("tensors: {action: torque, observation: obs}\n")
    with pytest.raises(InputError, match="has no output 'torque'; its outputs are actions, joint_pos, joint_vel"):
        load_checkpoint(path)
    (tmp_path / "contract.yaml").write_text("tensors: {action: joint_pos}\n")
    with pytest.raises(InputError, match="the model's output is 3 wide, expected 2"):
        load_checkpoint(path)
