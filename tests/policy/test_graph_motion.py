"""Motions inside a model's graph: read to their end, pauses included, and laid out for the policy."""

import dialects
import models
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.policy_step import PolicyWiring
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.mit import VELOCITY_COMMAND
from humanoid_sim.policy.checkpoint import load_checkpoint, zero_policy
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, motion_bytes, read_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy

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


def test_a_pause_is_not_the_end(tmp_path):
    motion = {name: np.repeat(table, [1, 130, 1, 1, 60, 1, 5], axis=0) for name, table in tables().items()}
    read = load_checkpoint(saved(tmp_path / "t.onnx", motion)).motion
    assert len(read.frames) == 195  # the last pose is shown five times, and held anyway


def test_one_frame_is_a_motion(tmp_path):
    read = load_checkpoint(saved(tmp_path / "t.onnx", tables(frames=1))).motion
    assert len(read.frames) == 1


def test_quaternions_the_other_way_round(tmp_path):
    motion = tables()
    turned = {**motion, "body_quat_w": motion["body_quat_w"][..., [1, 2, 3, 0]]}
    path = saved(tmp_path / "t.onnx", turned, contract(reference_quaternion="xyzw"))
    read = load_checkpoint(path).motion
    assert np.array_equal(read.frames[:, 12:].reshape(7, 2, 4), motion["body_quat_w"])


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


def test_a_motion_that_is_not_finite_is_refused(tmp_path):
    motion = tables()
    motion["joint_pos"][2, 1] = np.nan
    with pytest.raises(InputError, match=r"motion in its graph: Motion\.frames: value 1 of frame 2 is nan"):
        load_checkpoint(saved(tmp_path / "t.onnx", motion))


def test_a_graph_that_fails_beyond_its_end_ends_there(tmp_path):
    read = load_checkpoint(saved(tmp_path / "t.onnx", tables(), clamps=False)).motion
    assert len(read.frames) == 7


def test_time_step_selects_the_frame(tmp_path):
    motion = tables()
    policy = OnnxPolicy(saved(tmp_path / "t.onnx", motion))
    (row,) = policy.run(["joint_pos"], np.zeros(15, dtype=np.float32), 4)
    assert np.array_equal(row[0], motion["joint_pos"][4])


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


def test_a_motion_without_what_the_policy_needs_is_refused():
    policy = contract(joint_names=("a", "b", "d"), action_joint_names=("a", "b"))
    with pytest.raises(InputError, match=r"unknown joint 'd'; known: a, b, c \(joints of the motion\)"):
        load_policy(policy, zero_policy(2), Motion(**FILE))
    with pytest.raises(InputError, match="'motion_anchor_ori_b' needs a motion with the poses of the anchor body"):
        load_policy(contract(anchor_body="head"), zero_policy(2), Motion(**FILE))


def test_a_robot_without_an_estimator_is_told_so():
    loaded = load_policy(contract(), zero_policy(2), Motion(**FILE))
    with pytest.raises(FieldError, match="'motion_anchor_ori_b' needs the robot's anchor pose"):
        PolicyWiring(loaded.contract.joint_names, loaded.contract, loaded.reference, {VELOCITY_COMMAND: 3})


def test_named_tensors_are_used(tmp_path):
    path = saved(tmp_path / "t.onnx", tables())
    (tmp_path / "contract.yaml").write_text("tensors: {action: torque, observation: obs}\n")
    with pytest.raises(InputError, match="has no output 'torque'; its outputs are actions, joint_pos, joint_vel"):
        load_checkpoint(path)
    (tmp_path / "contract.yaml").write_text("tensors: {action: joint_pos}\n")
    with pytest.raises(InputError, match="the model's output is 3 wide, expected 2"):
        load_checkpoint(path)
