"""`policy show`: the whole contract, readable and as JSON."""

import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import onnx
import pytest
from published import G1, POLICIES, TRACES, contract_beside, needs_policies
from trainer import JOINTS, contract, save_checkpoint, terms

from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.describe import field_lines, term_lines
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy_tools.stamp import add_metadata


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


def test_a_policy_that_ships_goes_by_its_name(cli):
    status, out, error = cli("show", "lite_biped_velocity")
    assert (status, error) == (0, "")
    assert "lite_biped_velocity.onnx" in out


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


def test_a_refused_checkpoint_is_shown_with_its_problem(cli, stamped):
    wrong = stamped.with_name("wrong.onnx")
    wiring = contract(observation=terms(projected_gravity={"scale": -1.0}))
    wrong.write_bytes(add_metadata(stamped, {STAMP_KEY: encode(wiring)}))
    status, out, _ = cli("show", wrong)
    assert status == 1
    assert "REFUSED" in out
    assert "projected_gravity[0]" in out
    status, out, _ = cli("show", wrong, "--json")
    assert status == 1
    assert "projected_gravity[0]" in json.loads(out)["golden"]["problem"]


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


def test_steps_that_lie_together_start_within_the_first():
    names = [term.name for term in terms()]
    wiring = contract(history_layout="per_step", observation=terms(**{name: {"history": 2} for name in names}))
    lines = term_lines(wiring, contract_layout(wiring))
    assert [line.start for line in lines] == [0, 3, 6, 9, 13, 17, 20, 22]
    assert sum(line.width for line in lines) == 48


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


@needs_policies
def test_joints_by_place_are_shown_by_their_places_without_the_robot(cli):
    status, out, error = cli("show", POLICIES / TRACES["unitree"][0])
    assert (status, error) == (0, "")
    assert out.startswith("no source names the joints, so they are shown by their places on the robot; --robot gives")
    assert "joint 28 of the robot" in out


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


def test_what_is_known_of_a_contract_that_lacks_fields(cli, tmp_path, bare):
    (tmp_path / "contract.yaml").write_text(PARTLY)
    status, out, error = cli("show", bare)
    assert (status, error) == (1, "")
    assert "missing: default_joint_pos, action_scale, policy_dt; write them into " in out
    assert f"into {tmp_path / 'contract.yaml'}, which --skeleton FILE begins (docs/contract.md)" in out
    for row in (
        ["1", "left_knee", "41.5", "1.25"],
        ["observation.projected_gravity.scale", "-1", "contract.yaml"],
        ["action_joint_names", "all joints", "follows from joint_names"],
        ["inputs", "obs [1, 32]"],
    ):
        assert row in rows(out)

    status, out, _ = cli("show", bare, "--json")
    assert status == 1
    document = json.loads(out, parse_constant=pytest.fail)
    assert document["missing"] == ["default_joint_pos", "action_scale", "policy_dt"]
    assert document["known"]["joint_stiffness"] == {"value": [40.5, 41.5], "source": "contract.yaml"}
    assert document["known"]["action_clip"]["value"] is None
    assert document["model"]["inputs"][0]["shape"] == [1, 32]


def test_a_network_of_which_nothing_is_known_shows_its_tensors_and_what_is_missing(cli, bare):
    status, out, error = cli("show", bare)
    assert (status, error) == (1, "")
    assert ["inputs", "obs [1, 32]"] in rows(out)
    assert "missing: joint_names, " in out
    assert "known so far" not in out
    status, out, _ = cli("show", bare, "--json")
    assert (status, json.loads(out)["known"]) == (1, {})


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


def test_keys_of_a_piano_policy_follow_from_the_models_input():
    wiring = contract(
        task_type="piano",
        observation=("joint_pos", "target_keys", "target_keys_future", "key_pressed"),
        lookahead_steps=(1, 2, 5),
        phase=None,
    )
    assert contract_layout(wiring, 4 + 88 * 5).width == 4 + 88 * 5
    assert contract_layout(wiring).width == 4 + 5
    assert contract_layout(wiring, 17).width == 9  # no whole number of keys: the check of widths says so


def test_help_and_unknown_options(cli):
    status, out, _ = cli("--help")
    assert status == 0
    for verb in ("show", "check", "stamp", "doctor"):
        assert verb in out
    assert cli("show", "x.onnx", "--colour")[0] == 2
    assert cli("look", "x.onnx")[0] == 2


def test_a_complete_checkpoint_shows_the_same_from_its_thirteen_keys(cli, tmp_path):
    """What the keys say is read alike with and without the stamp."""
    plain = contract(observation=("joint_pos", "joint_vel", "actions", "twist"), phase=None, command_ranges=None)
    outputs = []
    for complete in (False, True):
        path = save_checkpoint(tmp_path / f"{complete}.onnx", plain, complete=complete)
        status, out, error = cli("show", path, "--json")
        assert status == 0, error
        wiring = json.loads(out)["contract"]
        del wiring["provenance"], wiring["assumed"]
        outputs.append(wiring)
    assert outputs[0] == outputs[1]
    np.testing.assert_array_equal(outputs[0]["joint_damping"], plain.joint_damping)


def test_the_doctor_is_reached(cli, tmp_path, monkeypatch):
    heard = []

    def doctor(config):
        heard.append(config)
        return 3

    monkeypatch.setitem(sys.modules, "humanoid_sim.doctor.run", SimpleNamespace(doctor=doctor))
    path = tmp_path / "x.onnx"
    path.write_bytes(b"a model")
    assert cli("doctor", path, "--robot", "lite", "--top", "3")[0] == 3
    assert heard == [DoctorConfig(path, "lite", top=3)]
