"""`policy show`: the whole contract, readable and as JSON."""

import json
import re

import onnx
import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import JOINTS, contract, terms

from humanoid_sim.policy.describe import field_lines, term_lines
from humanoid_sim.policy.loaded_policy import contract_layout


@pytest.fixture
def bare(tmp_path, walker):
    """The walker without a word about itself."""
    path = tmp_path / "bare.onnx"
    model = onnx.load(str(walker))
    del model.metadata_props[:]
    onnx.save(model, str(path))
    return path


def rows(out):
    """The cells of the tables that were printed."""
    return [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines() if line.startswith("│")]


def test_tables(cli, stamped):
    status, out, error = cli("show", stamped)
    assert (status, error) == (0, "")
    assert "32 values in 8 terms" in out
    assert "8 samples of the trainer's run (trace.npz)" in out
    lines = {cells[1]: cells[2:] for cells in rows(out) if len(cells) > 3}
    assert "held at 0" in lines["left_knee"]
    assert lines["right_knee"] == ["0.5", "51", "2.1", "action 0", "0.25", "0.5"]
    assert "3 steps, oldest first" in out
    assert "period 0.8 s" in out
    assert "vx -1 to 1, vy -0.5 to 0.5" in out


def test_json_is_complete(cli, stamped):
    status, out, _ = cli("show", stamped, "--json")
    assert status == 0
    document = json.loads(out, parse_constant=pytest.fail)  # no Infinity, no NaN: other programs read it
    wiring = document["contract"]
    assert wiring["joint_names"] == list(JOINTS)
    assert wiring["action_clip"] is None
    places = {term["name"]: (term["start"], term["width"]) for term in wiring["observation"]}
    assert places["joint_pos_rel"] == (9, 12)
    assert places["cos_phase"] == (30, 2)
    assert wiring["observation_width"] == 32 == document["model"]["observation_width"]
    assert wiring["phase"]["period"] == 0.8
    assert wiring["provenance"]
    assert document["golden"] == {"label": "8 samples of the trainer's run (trace.npz)", "problem": ""}
    assert document["model"]["inputs"] == [{"name": "obs", "type": "tensor(float)", "shape": [1, 32]}]


def test_conventions_that_differ_are_named():
    wiring = contract(
        observation=terms(
            base_ang_vel={"frame": "world", "clip": (-5.0, 5.0)},
            joint_pos_rel={"relative": False, "joints": ("left_hip", "left_knee")},
            last_action={"form": "scaled"},
        )
    )
    lines = {line.name: line for line in term_lines(wiring, contract_layout(wiring))}
    assert lines["base_ang_vel"].conventions == "frame world, clip -5 to 5"
    assert lines["joint_pos_rel"].conventions == "joints left_hip, left_knee"
    assert lines["joint_pos_rel"].meaning.endswith("absolute")
    assert lines["joint_pos_rel"].width == 6
    assert lines["last_action"].conventions == "form scaled"
    assert lines["projected_gravity"].conventions == ""


def test_sources_and_assumptions():
    wiring = contract(
        provenance={
            "policy_dt": "assumed (mjlab)",
            **{f"observation.{term.name}.scale": "deploy.yaml" for term in terms()},
            "observation.last_action.form": "contract.yaml",
        }
    )
    lines = {line.name: line for line in field_lines(wiring)}
    assert lines["policy_dt"].source == "assumed (mjlab)"
    assert lines["terms' scale"].value == "of every term"
    assert lines["terms' form"].value == "of last_action"
    assert lines["anchor_body"].source == "default"


@needs_policies
def test_published_policies(cli, tmp_path):
    rest = contract_beside("holosoma", tmp_path)
    for name, options, texts in (
        ("unitree", ("--robot", G1), ("deploy.yaml and the robot", "vx -0.5 to 1")),
        ("waltz", (), ("assumed (mjlab)", "in the model: 945 frames", "torso_link", "policy_dt 0.02 s (50 Hz)")),
        ("mjlab", (), ("at imu", "no source states it: policy_dt 0.02 s (50 Hz); terms' at of base_lin")),
        ("holosoma", ("--contract", rest), ("holosoma metadata", "rest.yaml")),
    ):
        status, out, error = cli("show", POLICIES / TRACES[name][0], *options)
        assert (status, error) == (0, "")
        for text in texts:
            assert text in out


def test_bad_input_is_one_line(cli, tmp_path, bare):
    text = tmp_path / "text.onnx"
    text.write_text("no model")
    stamp = ["stamp", "-o", tmp_path / "out.onnx"]
    for path in (tmp_path / "missing.onnx", tmp_path, text, bare):
        for verb in (["show"], stamp) if path != bare else (stamp,):
            status, out, error = cli(verb[0], path, *verb[1:])
            assert (status, out) == (2, "")
            assert error.startswith(f"error: {path}: ")
            assert error.count("\n") == 1


PARTLY = """\
joint_names: [left_hip, left_knee]
joint_stiffness: [40.5, 41.5]
joint_damping: 1.25
observation: [base_ang_vel, {name: projected_gravity, scale: -1.0}]
action_clip: .inf
"""


def test_a_skeleton_states_nothing_until_it_is_filled_in(cli, tmp_path, walker, bare):
    file = tmp_path / "bare.contract.yaml"
    _, out, _ = cli("show", bare, "--json")
    missing = json.loads(out)["missing"]
    assert missing[:4] == ["joint_names", "joint_stiffness", "joint_damping", "default_joint_pos"]
    status, out, error = cli("show", bare, "--skeleton", file)
    assert (status, error) == (1, "")
    assert f"missing: {', '.join(missing)}; fill it in, in {file}" in out
    text = file.read_text()
    assert "# inputs: obs [1, 32]\n" in text
    assert "\n#joint_stiffness: NUMBER\n" in text
    assert re.findall("^#([a-z_]+):", text, flags=re.M) == missing
    assert json.loads(cli("show", bare, "--json")[1])["missing"] == missing
    filled = re.sub("^#([a-z])", r"\1", text, flags=re.M).replace("[TERM, TERM]", "[joint_pos]")
    file.write_text(filled.replace("[NAME, NAME]", "[a, b]").replace("NUMBER", "0.02"))
    wide = "the model's output is 3 wide, expected 2, one for each of action_joint_names"  # nothing is missing
    assert cli("show", bare) == (2, "", f"error: {bare}: {wide}\n")

    refused = f"error: --skeleton: '{file}' exists; choose another name\n"
    assert cli("show", bare, "--skeleton", file) == (2, "", refused)
    (tmp_path / "contract.yaml").write_text(PARTLY)
    file.unlink()
    _, _, error = cli("show", bare, "--skeleton", file)
    assert error == (
        f"error: --skeleton: {bare} has a contract file, {tmp_path / 'contract.yaml'}; add to it what is missing: "
        "default_joint_pos, action_scale, policy_dt\n"
    )
    assert not file.exists()
    (tmp_path / "contract.yaml").unlink()
    _, _, error = cli("show", walker, "--skeleton", file)
    assert error == f"error: --skeleton: nothing is missing from the contract of {walker}\n"
