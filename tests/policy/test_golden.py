"""Golden vectors: a checkpoint that is wired differently than where it was trained is refused at load."""

import json

import pytest
from trainer import JOINTS, SCALE, contract, terms

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_metadata
from humanoid_sim.policy.readers.own import GOLDEN_KEY, STAMP_KEY, encode, write_metadata
from humanoid_sim.policy_tools.stamp import add_metadata

MISTAKES = {
    # name: what the contract says instead, the value that the refusal names
    "permuted joints": (
        {"joint_names": (JOINTS[1], JOINTS[0], *JOINTS[2:])},
        "joint_pos_rel[0] of history step 0 (right_hip)",
    ),
    "a scale": ({"observation": terms(joint_vel_rel={"scale": 1.0})}, "joint_vel_rel[0] (left_hip)"),
    "gravity's sign": ({"observation": terms(projected_gravity={"scale": -1.0})}, "projected_gravity[0]"),
    "world frame": ({"observation": terms(base_ang_vel={"frame": "world"})}, "base_ang_vel[0]"),
    "history order": ({"observation": terms(joint_pos_rel={"history_order": "newest_first"})}, "joint_pos_rel[0]"),
    "scaled last action": ({"observation": terms(last_action={"form": "scaled"})}, "last_action[0] (right_knee)"),
    "default pose": ({"default_joint_pos": [-0.2, 0.1, 0.6, 0.4]}, "joint_pos_rel[3] of history step 0 (right_knee)"),
    "action scale": ({"action_scale": 1.0}, "target of left_hip"),
    "rounded scale": ({"action_scale": SCALE + 4e-4}, "action_scale was rounded in export"),
    "action order": ({"action_joint_names": ("left_hip", "right_knee", "right_hip")}, "target of left_hip"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_wrong_wiring_is_refused_at_load(stamped, mistake):
    changes, named = MISTAKES[mistake]
    wiring = contract(**changes)
    stamped.write_bytes(add_metadata(stamped, {**write_metadata(wiring), STAMP_KEY: encode(wiring)}))
    with pytest.raises(InputError) as refusal:
        load_checkpoint(stamped)
    message = str(refusal.value)
    assert message.startswith(f"{stamped}: golden vectors: sample ")
    assert named in message
    assert "\n" not in message
    assert load_checkpoint(stamped, verify=False).golden == ""


@pytest.mark.parametrize("changes", [{"version": 7}, {"arrays": {}}, {"joint_names": ["a", "b", "c", "d"]}])
def test_broken_samples_are_one_line(stamped, changes):
    text = json.dumps({**json.loads(read_metadata(stamped)[GOLDEN_KEY]), **changes})
    for content in (text, text[:-9]):
        stamped.write_bytes(add_metadata(stamped, {GOLDEN_KEY: content}))
        with pytest.raises(InputError, match=r"golden vectors[^\n]+$"):
            load_checkpoint(stamped)
