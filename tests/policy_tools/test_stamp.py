"""A stamped copy needs no other file, and answers bit for bit what the original does."""

import shutil
from dataclasses import replace

import numpy as np
import onnx
import pytest
from dialects import said
from published import G1, MJLAB, POLICIES, TRACES, contract_beside, needs_policies
from trainer import Run, contract, save_checkpoint, save_trace

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.golden import golden_problem, stored_samples
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.readers.own import GOLDEN_KEY, METADATA_KEYS, STAMP_KEY, read_own, write_metadata
from humanoid_sim.policy_tools.stamp import add_metadata
from humanoid_sim.robots.description import load_robot


@needs_policies
@pytest.mark.usefixtures("near_ends")
@pytest.mark.parametrize("name", TRACES)
def test_published_policy(cli, tmp_path, name):
    """Every step of a published run agrees, and the copy needs no robot, no contract and no tensors beside it."""
    (model, trace), rest = TRACES[name], contract_beside(name, tmp_path)
    output = tmp_path / "alone" / "stamped.onnx"
    output.parent.mkdir()
    extra = ["--contract", rest] if rest else []
    status, out, error = cli(
        "stamp", POLICIES / model, "-o", output, "--robot", G1, "--trace", POLICIES / trace, *extra
    )
    assert (status, error) == (0, "")
    assert "trainer's run" in out
    original = load_checkpoint(POLICIES / model, rest, load_robot(str(G1)).joint_names)
    copy = load_checkpoint(output)
    assert "trainer's run" in copy.golden
    probes = np.random.default_rng(3).normal(size=(20, original.observation_width)).astype(np.float32)
    for frame, observation in enumerate(probes):
        np.testing.assert_array_equal(copy.policy(observation, frame), original.policy(observation, frame))
    assert said(copy.contract) == said(original.contract)
    assert (copy.motion is None) == (original.motion is None)
    if copy.motion is not None:
        assert copy.motion.frames.shape == (945, 2 * 29 + 7 * 14)
        assert copy.motion.frames.tobytes() == original.motion.frames.tobytes()

    # Stamped again, without the trace, it keeps the trainer's samples.
    again = tmp_path / "again.onnx"
    assert cli("stamp", output, "-o", again)[0] == 0
    assert read_header(again)[0][GOLDEN_KEY] == read_header(output)[0][GOLDEN_KEY]


@needs_policies
@pytest.mark.usefixtures("near_ends")
def test_mjlabs_velocity_is_not_that_of_the_bases_origin(cli, tmp_path):
    model, trace = (POLICIES / name for name in MJLAB)
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("terms: {base_lin_vel: {at: base}}", encoding="utf-8")
    wiring = ("--robot", G1, "--trace", trace, "--contract", wrong)
    status, _, error = cli("stamp", model, *wiring, "-o", tmp_path / "x.onnx")
    assert status == 2
    assert "observation base_lin_vel[" in error


def test_writes_the_thirteen_keys_the_contract_and_the_samples(stamped):
    metadata = read_header(stamped)[0]
    assert set(metadata) == {*METADATA_KEYS, STAMP_KEY, GOLDEN_KEY}
    (thirteen,) = read_own(metadata, "stamped")
    assert tuple(thirteen.values["joint_names"]) == contract().joint_names
    np.testing.assert_array_equal(thirteen.values["joint_damping"], contract().joint_damping)
    samples = stored_samples(load_checkpoint(stamped))
    assert (samples.name, len(samples), "target" in samples.arrays) == ("trace.npz", 8, True)


def test_external_tensors_move_into_the_copy(cli, walker, tmp_path):
    expected, output = load_checkpoint(walker), tmp_path / "out.onnx"
    model = tmp_path / "external" / "policy.onnx"
    model.parent.mkdir()
    outside = {"save_as_external_data": True, "location": "policy.onnx.data", "size_threshold": 0}
    onnx.save(onnx.load(str(walker)), str(model), **outside)
    assert cli("stamp", model, "-o", output)[0] == 0
    shutil.rmtree(model.parent)
    observation = np.linspace(-1.0, 1.0, expected.observation_width, dtype=np.float32)
    np.testing.assert_array_equal(load_checkpoint(output).policy(observation, 0), expected.policy(observation, 0))


def test_refuses_to_overwrite(cli, walker, tmp_path):
    output = tmp_path / "out.onnx"
    output.write_text("mine")
    status, _, error = cli("stamp", walker, "-o", output)
    assert (status, error) == (2, f"error: --output: '{output}' exists; choose another name, or add --overwrite\n")
    assert output.read_text() == "mine"
    assert cli("stamp", walker, "-o", output, "--overwrite")[0] == 0
    assert load_checkpoint(output).contract.joint_names == contract().joint_names


def test_a_wrongly_wired_checkpoint_is_not_stamped(cli, tmp_path):
    wrong = save_checkpoint(tmp_path / "wrong.onnx", contract(default_joint_pos=[0.1, -0.2, 0.6, 0.5]))
    trace = save_trace(tmp_path / "trace.npz", Run())
    output = tmp_path / "out.onnx"
    status, _, error = cli("stamp", wrong, "-o", output, "--trace", trace)
    assert status == 2
    assert "joint_pos_rel[0] of history step 0 (left_hip)" in error
    assert "the trainer's is" in error
    assert not output.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["trace.npz", "wrong.onnx"]


def test_a_key_changed_after_stamping_is_refused(stamped):
    """The thirteen keys and the stamped contract say the same; neither may silently win over the other."""
    slower = write_metadata(contract(policy_dt=0.04))["policy_dt"]
    stamped.write_bytes(add_metadata(stamped, {"policy_dt": slower}))
    with pytest.raises(InputError, match=r"policy_dt: 0.02 in .*, 0.04 in metadata"):
        load_checkpoint(stamped)


def test_a_motion_from_a_file_is_in_the_samples():
    """The shipped policy follows motions from files, and is verified without any."""
    checkpoint = load_checkpoint(asset_path("policies", "lite_tracking.onnx"))
    samples = stored_samples(checkpoint)
    assert {"motion_body_pos_b", "motion_body_ori_b"} == set(samples.under("reference/"))
    shifted = replace(checkpoint, contract=replace(checkpoint.contract, default_joint_pos=np.full(14, 0.1)))
    assert "joint_pos[0] (left_shoulder_pitch)" in golden_problem(shifted, samples)
