"""Motions inside a model's graph: read to their end, pauses included, and laid out for the policy."""

import models
import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.contract import TensorNames
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.readers.own import STAMP_KEY, encode

pytestmark = pytest.mark.usefixtures("near_ends")

RNG = np.random.default_rng(0)
MOTION = {
    "joint_pos": RNG.normal(size=(7, 3)).astype(np.float32),
    "joint_vel": RNG.normal(size=(7, 3)).astype(np.float32),
    "body_pos_w": RNG.normal(size=(7, 2, 3)).astype(np.float32),
    "body_quat_w": RNG.normal(size=(7, 2, 4)).astype(np.float32),
}
"""Seven frames of three joints and two bodies, quaternions w x y z."""


def contract(**changes):
    values = {
        "task_type": "tracking",
        "observation": ("motion_command", "motion_anchor_ori_b", "joint_pos"),
        "body_names": ("pelvis", "torso"),
        "anchor_body": "torso",
    }
    return models.contract(**{**values, **changes})


@pytest.fixture
def saved(tmp_path):
    """Saves a model that answers row `time_step` of each table, like those of whole_body_tracking."""

    def save(motion, wiring, *, clamps=True):
        node, info, number = helper.make_node, helper.make_tensor_value_info, TensorProto.FLOAT
        nodes = [
            node("MatMul", ["obs", "weights"], ["actions"]),
            node("Cast", ["time_step"], ["whole"], to=TensorProto.INT64),
            node("Reshape", ["whole", "one"], ["wanted"]),
            node("Min", ["wanted", "last"], ["row"]) if clamps else node("Identity", ["wanted"], ["row"]),
            *(node("Gather", [f"{name}_table", "row"], [name]) for name in motion),
        ]
        last = len(motion["joint_pos"]) - 1
        constants = {"weights": models.weights(15, 2), "one": np.array([1]), "last": np.array([last])}
        constants |= {f"{name}_table": table for name, table in motion.items()}
        widths = {"actions": (2,), **{name: table.shape[1:] for name, table in motion.items()}}
        graph = helper.make_graph(
            nodes,
            "tracker",
            [info("obs", number, [1, 15]), info("time_step", number, [1, 1])],
            [info(name, number, [1, *shape]) for name, shape in widths.items()],
            [numpy_helper.from_array(value, name) for name, value in constants.items()],
        )
        return models.saved(tmp_path / "t.onnx", models.finished(graph, {STAMP_KEY: encode(wiring)}))

    return save


@pytest.mark.parametrize("clamps", [True, False])
def test_a_motion_is_read_as_the_graph_has_it_and_its_anchor_followed(saved, clamps):
    """To the frame that is held, or to the last that there is."""
    checkpoint = load_checkpoint(saved(MOTION, contract(), clamps=clamps))
    read = checkpoint.motion
    assert read.frames.tobytes() == np.concatenate([table.reshape(7, -1) for table in MOTION.values()], 1).tobytes()
    assert (read.joint_names, read.body_names, read.policy_dt) == (models.JOINTS, ("pelvis", "torso"), 0.02)
    reference = checkpoint.with_motion().reference
    assert np.array_equal(reference.term("anchor_pos", 3), MOTION["body_pos_w"][3, 1])
    assert np.array_equal(reference.term("anchor_quat", 3), MOTION["body_quat_w"][3, 1])
    assert np.array_equal(reference.term("reference_joint_pos", 99), MOTION["joint_pos"][6])
    assert np.array_equal(reference.term("reference_joint_vel", 2), MOTION["joint_vel"][2])


def test_a_pause_is_not_the_end(saved):
    paused = {name: np.repeat(table, [1, 1, 130, 1, 1, 60, 1], axis=0) for name, table in MOTION.items()}
    assert len(load_checkpoint(saved(paused, contract())).motion.frames) == 195


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body_names": ("pelvis",), "anchor_body": "pelvis"}, "output 'body_pos_w' has 6 values, expected 3"),
        ({"tensors": TensorNames(action="torque")}, "unknown output 'torque'; known: actions, joint_pos"),
        ({"tensors": TensorNames(action="joint_pos")}, "the model's output is 3 wide, expected 2"),
    ],
)
def test_outputs_that_do_not_fit_are_named(saved, changes, message):
    with pytest.raises(InputError, match=message):
        load_checkpoint(saved(MOTION, contract(**changes)))
