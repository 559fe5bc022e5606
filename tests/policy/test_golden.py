"""Golden vectors: a checkpoint that is wired differently than where it was trained is refused at load."""

import json

import pytest
from trainer import JOINTS, contract, terms

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.readers.own import GOLDEN_KEY, STAMP_KEY, encode, write_metadata
from humanoid_sim.policy_tools.stamp import add_metadata


def rewired(stamped, wiring):
    """The same file with another contract stamped into it."""
    path = stamped.with_name("rewired.onnx")
    path.write_bytes(add_metadata(stamped, {**write_metadata(wiring), STAMP_KEY: encode(wiring)}))
    return path


MISTAKES = {
    "permuted joints": (
        {"joint_names": (JOINTS[1], JOINTS[0], *JOINTS[2:])},
        "joint_pos_rel[0] of history step 0 (right_hip)",
    ),
    "forgotten observation scale": (
        {"observation": terms(joint_vel_rel={"scale": 1.0})},
        "joint_vel_rel[0] (left_hip)",
    ),
    "gravity sign": ({"observation": terms(projected_gravity={"scale": -1.0})}, "projected_gravity[0]"),
    "world frame": ({"observation": terms(base_ang_vel={"frame": "world"})}, "base_ang_vel[0]"),
    "absolute positions": (
        {"observation": terms(joint_pos_rel={"relative": False})},
        "joint_pos_rel[0] of history step 0",
    ),
    "history order": (
        {"observation": terms(joint_pos_rel={"history_order": "newest_first"})},
        "joint_pos_rel[0] of history",
    ),
    "scaled last action": ({"observation": terms(last_action={"form": "scaled"})}, "last_action[0] (right_knee)"),
    "zeroed term": ({"observation": terms(velocity_commands={"scale": 0.0})}, "velocity_commands[0]"),
    "term order": ({"observation": terms()[::-1]}, "cos_phase[0]"),
    "default pose": ({"default_joint_pos": [-0.2, 0.1, 0.6, 0.4]}, "joint_pos_rel[3] of history step 0 (right_knee)"),
    "phase period": ({"phase": PhaseRule(1.0)}, "sin_phase[0]"),
    "phase one step late": ({"phase": PhaseRule(0.8, advance_first=False)}, "sin_phase[0]"),
    "command ranges": ({"command_ranges": [[-0.1, 0.1], [-0.5, 0.5], [-1.0, 1.0]]}, "velocity_commands[0]"),
    "action scale": ({"action_scale": 1.0}, "target of left_hip"),
    "action order": ({"action_joint_names": ("left_hip", "right_knee", "right_hip")}, "target of left_hip"),
    "action offset": ({"action_offset": [0.5, -0.2, 0.2]}, "target of right_hip"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_wrong_wiring_is_refused_at_load(stamped, mistake):
    changes, named = MISTAKES[mistake]
    wrong = rewired(stamped, contract(**changes))
    with pytest.raises(InputError) as refusal:
        load_checkpoint(wrong)
    message = str(refusal.value)
    assert message.startswith(f"{wrong}: golden vectors: sample ")
    assert named in message, message
    assert "the trainer's is" in message
    assert "\n" not in message
    assert load_checkpoint(wrong, verify=False).golden == ""


def test_a_contract_beside_the_checkpoint_that_contradicts_them_is_refused_too(stamped):
    stamped.with_name("contract.yaml").write_text("action_scale: 1.0\n", encoding="utf-8")
    with pytest.raises(InputError, match="target of"):
        load_checkpoint(stamped)


def test_samples_of_the_programs_own_wiring_prove_nothing(stamped):
    """Checkpoints that were stamped without a trace used to hold such."""
    document = json.loads(read_header(stamped)[0][GOLDEN_KEY])
    stamped.write_bytes(add_metadata(stamped, {GOLDEN_KEY: json.dumps({**document, "origin": "own"})}))
    assert load_checkpoint(stamped).golden == ""


BROKEN = {
    "no JSON": lambda _: "{",
    "another version": lambda document: {**document, "version": 7},
    "no arrays": lambda document: {**document, "arrays": {}},
    "no base64": lambda document: with_action(document, data="!"),
    "too short": lambda document: with_action(document, data=document["arrays"]["action"]["data"][:-8]),
    "other joints": lambda document: {**document, "joint_names": ["a", "b", "c", "d"]},
}


def with_action(document, **changes):
    arrays = document["arrays"]
    return {**document, "arrays": {**arrays, "action": {**arrays["action"], **changes}}}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_stamp_is_one_line(stamped, name):
    content = BROKEN[name](json.loads(read_header(stamped)[0][GOLDEN_KEY]))
    text = content if isinstance(content, str) else json.dumps(content)
    stamped.write_bytes(add_metadata(stamped, {GOLDEN_KEY: text}))
    with pytest.raises(InputError, match=r"golden vectors: [^\n]+$"):
        load_checkpoint(stamped)
