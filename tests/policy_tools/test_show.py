"""`policy show`: one table of what is known and where it comes from, and what was found and not used."""

import json
import re

import onnx
import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import JOINTS


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
    assert "joint_pos_rel 12 + joint_vel_rel 4" in lines["observation"]
    assert "history 3 of joint_pos_rel" in " ".join(out.split())
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


@needs_policies
@pytest.mark.usefixtures("near_ends")
def test_published_policies(cli, tmp_path):
    rest = contract_beside("holosoma", tmp_path)
    for name, options, texts in (
        ("unitree", ("--robot", G1), ("deploy.yaml and the robot", "command_ranges")),
        ("waltz", (), ("assumed (mjlab)", "torso_link", "0.02 s (50 Hz)")),
        ("mjlab", (), ("at imu of base_lin_vel", "assumed (mjlab)")),
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
