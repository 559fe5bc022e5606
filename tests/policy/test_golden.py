"""Golden vectors: a checkpoint that is wired differently than where it was trained is refused at load."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
from made_up import made_up_run
from trainer import JOINTS, contract, terms

from humanoid_sim.controllers.contract import PhaseRule
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import GOLDEN_KEY, load_checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.golden import encode_samples, golden_problem, stored_samples, trainer_samples
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.traces import Trace, read_trace
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


def test_what_an_exporters_rounding_explains_says_so(stamped):
    for scale, is_explained in (([0.2504, 0.4996, 0.3503], True), ([0.2504, 0.4996, 0.36], False)):
        with pytest.raises(InputError, match="target of") as refusal:
            load_checkpoint(rewired(stamped, contract(action_scale=scale)))
        assert ("rounded by its exporter" in str(refusal.value)) == is_explained


def test_right_wiring_loads(stamped):
    assert load_checkpoint(stamped).golden == "8 samples of the trainer's run (trace.npz)"
    assert load_checkpoint(rewired(stamped, contract())).golden


def test_an_override_beside_the_checkpoint_is_refused_too(stamped):
    stamped.with_name("contract.yaml").write_text("override: {action_scale: 1.0}\n", encoding="utf-8")
    with pytest.raises(InputError, match="target of"):
        load_checkpoint(stamped)


def test_another_model_is_refused_by_its_action(stamped):
    model = onnx.load(str(stamped))
    weights = np.frombuffer(model.graph.initializer[0].raw_data, dtype=np.float32).copy()
    weights[::3] *= 1.01  # the weights towards the first action
    model.graph.initializer[0].raw_data = weights.tobytes()
    onnx.save(model, str(stamped))
    match = r"action of right_knee is .*, the trainer's is .* \(1 of 3 values differ"
    with pytest.raises(InputError, match=match) as refusal:
        load_checkpoint(stamped)
    assert "tensors in" not in str(refusal.value)  # it has none beside it


def test_large_values_are_compared_by_their_size(walker):
    """An observation of some thousands in float32 is right to some thousandths, not to 1e-4."""
    scaled = contract(observation=terms(joint_vel_rel={"scale": 1000.0}))
    checkpoint = replace(load_checkpoint(walker, verify=False), contract=scaled)
    run = made_up_run(checkpoint)
    seen = run.arrays["observation"]
    assert np.abs(seen).max() > 100.0
    for by, named in ((5e-5, False), (2e-4, True)):
        other = Trace(run.name, run.joint_names, {**run.arrays, "observation": seen * np.float32(1.0 + by)})
        problem = golden_problem(checkpoint, other)
        assert ("observation" in problem) is named
        assert ("joint_vel_rel" in problem) is named


def test_samples_survive_their_encoding(stamped, walker, trace):
    checkpoint = load_checkpoint(walker)
    samples = trainer_samples(checkpoint, read_trace(trace, checkpoint.contract))
    again = stored_samples(load_checkpoint(stamped))
    assert encode_samples(again) == encode_samples(samples)
    assert again.arrays["joint_position"].dtype == np.float64
    np.testing.assert_array_equal(again.arrays["extern/velocity_command"], samples.arrays["extern/velocity_command"])
    assert np.isnan(again.arrays["history"][0]).all()  # at activation there is none


def test_samples_of_the_programs_own_wiring_prove_nothing(stamped):
    """Checkpoints that were stamped without a trace used to hold such."""
    document = json.loads(read_header(stamped)[0][GOLDEN_KEY])
    stamped.write_bytes(add_metadata(stamped, {GOLDEN_KEY: json.dumps({**document, "origin": "own"})}))
    assert load_checkpoint(stamped).golden == ""


def test_broken_stamps_are_one_line(stamped):
    document = json.loads(read_header(stamped)[0][GOLDEN_KEY])
    broken = {
        "no JSON": "{",
        "nothing": "",
        "another version": {**document, "version": 7},
        "no arrays": {**document, "arrays": {}},
        "no base64": _with(document, "action", data="!"),
        "too short": _with(document, "action", data=document["arrays"]["action"]["data"][:-8]),
        "huge": _with(document, "action", shape=[10**9, 10**9]),
        "other width": _with(document, "imu_quaternion", shape=[4, 8]),
        "no joints": {**document, "joint_names": []},
        "other joints": {**document, "joint_names": ["a", "b", "c", "d"]},
        "frames": {**document, "frame_count": "many"},
    }
    for name, content in broken.items():
        text = content if isinstance(content, str) else json.dumps(content)
        path = stamped.with_name("broken.onnx")
        path.write_bytes(add_metadata(stamped, {GOLDEN_KEY: text}))
        with pytest.raises(InputError) as refusal:
            load_checkpoint(path)
        assert "golden vectors" in str(refusal.value), name
        assert "\n" not in str(refusal.value), name


def _with(document, array, **changes):
    arrays = document["arrays"]
    return {**document, "arrays": {**arrays, array: {**arrays[array], **changes}}}
