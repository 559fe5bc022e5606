"""A stamped copy needs no other file, answers bit for bit what the original does, and is shown as one table."""

import json
import re

import numpy as np
import onnx
import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies

from humanoid_sim.assets import policy_path
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_metadata
from humanoid_sim.policy.readers.own import GOLDEN_KEY, METADATA_KEYS, STAMP_KEY, encode
from humanoid_sim.robots.description import load_robot


@needs_policies
@pytest.mark.usefixtures("near_ends")
@pytest.mark.parametrize("name", TRACES)
def test_the_trace_of_a_published_policy_is_accepted_and_the_copy_says_all(cli, tmp_path, name):
    """Every observation, action and target of the trainer's run is computed again, and the copy needs no other file."""
    model, trace = (POLICIES / path for path in TRACES[name])
    rest = contract_beside(name, tmp_path)
    output = tmp_path / "stamped.onnx"
    beside = ["--contract", rest] if rest else []
    status, out, error = cli("stamp", model, "-o", output, "--robot", G1, "--trace", trace, *beside)
    assert status == 0, error
    assert "trainer's run" in out
    status, out, _ = cli("check", output, "--robot", G1)
    assert (status, "0 error(s)" in out, "golden vectors: 8 samples of the trainer's run" in out) == (0, True, True)

    original = load_checkpoint(model, rest, load_robot(str(G1)).joint_names)
    (tmp_path / "alone").mkdir()
    copy = load_checkpoint(output.rename(tmp_path / "alone" / "stamped.onnx"))
    assert "trainer's run" in copy.golden
    with np.load(trace) as file:
        observations = file["obs"]
    for frame, observation in enumerate(observations):
        np.testing.assert_array_equal(copy.policy(observation, frame), original.policy(observation, frame))
    made, again = (json.loads(encode(checkpoint.contract)) for checkpoint in (original, copy))
    assert again == made
    if name == "waltz":  # its motion is in the graph
        assert copy.motion.frames.shape == (945, 2 * 29 + 7 * 14)


def test_stamped_again_without_a_trace_it_keeps_the_samples(cli, stamped, tmp_path):
    again = tmp_path / "again.onnx"
    status, _, error = cli("stamp", stamped, "-o", again)
    assert status == 0, error
    metadata = read_metadata(again)
    assert set(metadata) == {*METADATA_KEYS, STAMP_KEY, GOLDEN_KEY}
    assert metadata == read_metadata(stamped)
    assert load_checkpoint(again).golden == "8 samples of the trainer's run (trace.npz)"


def test_external_tensors_move_into_the_copy_which_replaces_nothing_unasked(cli, walker, tmp_path):
    model, data, output = (tmp_path / name for name in ("policy.onnx", "policy.onnx.data", "out.onnx"))
    beside = {"save_as_external_data": True, "location": data.name, "size_threshold": 0}
    onnx.save(onnx.load(str(walker)), str(model), **beside)
    expected = load_checkpoint(model)
    output.write_text("mine")
    status, _, error = cli("stamp", model, "-o", output)
    assert (status, "exists" in error, output.read_text()) == (2, True, "mine")
    assert cli("stamp", model, "-o", output, "--overwrite")[0] == 0
    data.unlink()
    observation = np.linspace(-1.0, 1.0, 32, dtype=np.float32)
    np.testing.assert_array_equal(load_checkpoint(output).policy(observation, 0), expected.policy(observation, 0))


def test_a_policy_that_follows_files_is_verified_without_any(tmp_path):
    shifted = tmp_path / "contract.yaml"
    shifted.write_text(f"default_joint_pos: {[0.1] * 14}\n", encoding="utf-8")
    assert "trainer's run" in load_checkpoint(policy_path("lite_tracking")).golden
    with pytest.raises(InputError, match=r"joint_pos\[0\] \(left_shoulder_pitch\)"):
        load_checkpoint(policy_path("lite_tracking"), shifted)


def test_a_contract_is_one_table_and_a_replaced_value_stands_behind_its_replacement(cli, stamped):
    status, out, error = cli("show", stamped)
    assert (status, error) == (0, "")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert "8 samples of the trainer's run (trace.npz)" in lines["golden"]
    assert "joint_pos_rel 12 + joint_vel_rel 4" in lines["observation"]
    assert "history 3 of joint_pos_rel" in " ".join(out.split())
    stamped.with_name("contract.yaml").write_text("policy_dt: 0.04\n")
    assert re.search(r"\npolicy_dt +0.04 .*contract.yaml \(replaces 0.02 .*\)", cli("show", stamped)[1])
