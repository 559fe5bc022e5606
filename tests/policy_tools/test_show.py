"""`policy show`: one table of what is known and where it comes from, and what was found and not used."""

import json
import re

import onnx
import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import JOINTS, contract, terms

from humanoid_sim.policy.describe import contract_rows


@pytest.fixture
def bare(tmp_path, walker):
    """The walker without a word about itself."""
    path = tmp_path / "bare.onnx"
    model = onnx.load(str(walker))
    del model.metadata_props[:]
    onnx.save(model, str(path))
    return path


def test_a_contract_is_one_table_and_a_replaced_value_stands_behind_its_replacement(cli, stamped):
    status, out, error = cli("show", stamped)
    assert (status, error) == (0, "")
    lines = {line.split()[0]: line for line in out.splitlines() if line.strip()}
    assert "8 samples of the trainer's run (trace.npz)" in lines["golden"]
    assert "[9:21]" in lines["joint_pos_rel"]
    assert "history 3" in lines["joint_pos_rel"]
    stamped.with_name("contract.yaml").write_text("policy_dt: 0.04\n")
    assert re.search(r"\npolicy_dt +0.04 s .* contract.yaml \(replaces 0.02 s .*\)", cli("show", stamped)[1])


def test_json_is_complete(cli, stamped):
    status, out, _ = cli("show", stamped, "--json")
    assert status == 0
    document = json.loads(out, parse_constant=pytest.fail)  # no Infinity, no NaN: other programs read it
    assert document["contract"]["joint_names"] == list(JOINTS)
    assert document["contract"]["action_clip"] is None
    assert document["contract"]["phase"]["period"] == 0.8
    assert {term["name"]: term["width"] for term in document["terms"]}["joint_pos_rel"] == 12
    assert (document["golden"], document["refusal"]) == ("8 samples of the trainer's run (trace.npz)", "")
    assert document["inputs"] == [{"name": "obs", "type": "tensor(float)", "shape": [1, 32]}]


def test_conventions_that_differ_and_assumptions_are_named():
    wiring = contract(
        observation=terms(
            base_ang_vel={"frame": "world", "clip": (-5.0, 5.0)},
            joint_pos_rel={"relative": False, "joints": ("left_hip", "left_knee")},
        ),
        source={"policy_dt": "assumed (mjlab)", "observation.base_ang_vel.clip": "contract.yaml"},
    )
    rows = {row.field: row for row in contract_rows(wiring)}
    assert rows["policy_dt"].source == "assumed (mjlab)"
    assert "clip [-5, 5]; frame world" in rows["base_ang_vel"].value
    assert "relative false; joints [left_hip, left_knee]" in rows["joint_pos_rel"].value
    assert rows["terms' clip"].source == "contract.yaml"


@needs_policies
@pytest.mark.usefixtures("near_ends")
def test_published_policies(cli, tmp_path):
    rest = contract_beside("holosoma", tmp_path)
    for name, options, texts in (
        ("unitree", ("--robot", G1), ("deploy.yaml and the robot", "command_ranges")),
        ("waltz", (), ("assumed (mjlab)", "945 frames", "torso_link", "0.02 s (50 Hz)")),
        ("mjlab", (), ("at imu", "terms' at", "assumed (mjlab)")),
        ("holosoma", ("--contract", rest), ("holosoma metadata", "rest.yaml")),
    ):
        status, out, error = cli("show", POLICIES / TRACES[name][0], *options)
        assert (status, error) == (0, "")
        for text in texts:
            assert text in out


def test_bad_input_is_one_line(cli, tmp_path, bare):
    for arguments in (("show", tmp_path / "missing.onnx"), ("stamp", bare, "-o", tmp_path / "out.onnx")):
        status, out, error = cli(*arguments)
        assert (status, out) == (2, "")
        assert error.startswith(f"error: {arguments[1]}: ")
        assert error.count("\n") == 1
