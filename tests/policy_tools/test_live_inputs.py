"""A contract with a live input is checked, shown and stamped without samples; programs that cannot feed it say so."""

import json

import pytest
from trainer import contract, save_checkpoint, terms

from humanoid_sim.cli import run_program
from humanoid_sim.controllers.contract import Term
from humanoid_sim.play import main as play
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.readers.own import GOLDEN_KEY, STAMP_KEY


@pytest.fixture
def live(tmp_path):
    """The trainer's policy, with two values of a sensor of its own in the place of a clock's."""
    observed = [Term("foot_contact", width=2) if term.name == "sin_phase" else term for term in terms()]
    return save_checkpoint(tmp_path / "live.onnx", contract(observation=observed))


def test_check_accepts_it_and_names_it(cli, live, robot):
    status, out, error = cli("check", live, "--robot", robot.mjcf_path)
    assert status == 0, error
    assert "observation term foot_contact: is a live input of width 2: programs send it by /foot_contact, or" in out
    assert "a policy with live inputs has none" in out


def test_show_says_by_which_topic_it_comes_and_when_it_is_stale(cli, live, tmp_path):
    file = tmp_path / "live.yaml"
    for options, told in (
        ("", "from other programs by /foot_contact, stale after 0.5 s"),
        ("topic: /feet, timeout: 0.2", "from other programs by /feet, stale after 0.2 s"),
        ("timeout: .inf", "from other programs by /foot_contact, never stale"),
    ):
        file.write_text(f"terms:\n  foot_contact: {{{options}}}\n", encoding="utf-8")
        status, out, error = cli("show", live, "--contract", file, "--json")
        assert status == 0, error
        (term,) = [term for term in json.loads(out)["terms"] if term["name"] == "foot_contact"]
        assert term["words"] == f"live input; {told}"


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("topic: /tf", "live input 'foot_contact': its topic is /tf, which a session uses itself"),
        ("topic: /lite/joint_states", "its topic is /lite/joint_states, which a session uses itself"),
        ("topic: feet", "topic: is 'feet', expected a ROS 2 name such as"),
        ("topic: 3", "observation.foot_contact.topic: is 3"),
        ("timeout: -1", "timeout: is -1.0, expected seconds > 0, or .inf"),
    ],
)
def test_declarations_that_are_refused(live, tmp_path, options, problem, capsys, robot):
    file = tmp_path / "live.yaml"
    file.write_text(f"terms:\n  foot_contact: {{{options}}}\n", encoding="utf-8")
    given = ["--policy", str(live), "--robot", str(robot.mjcf_path), "--contract", str(file)]
    assert run_program(play, given) == 2
    error = capsys.readouterr().err
    assert problem in error
    assert error.count("\n") == 1


def test_the_width_may_come_from_a_contract_file(cli, walker, tmp_path, robot):
    plain = save_checkpoint(tmp_path / "plain.onnx", contract(observation=[*terms()[:-2], "foot", "cos_phase"]))
    status, out, _ = cli("check", plain, "--robot", robot.mjcf_path)
    assert status == 1
    assert "unknown observation term 'foot'" in out
    assert "a width declares a live input: {name: foot, width: 2}" in out
    file = tmp_path / "live.yaml"
    file.write_text("terms:\n  foot: {width: 2}\n", encoding="utf-8")
    status, out, error = cli("check", plain, "--robot", robot.mjcf_path, "--contract", file)
    assert status == 0, out + error
    file.write_text("terms:\n  joint_pos_rel: {width: 4}\n", encoding="utf-8")
    status, out, _ = cli("check", plain, "--robot", robot.mjcf_path, "--contract", file)
    assert status == 1
    assert "width: is 4, expected none: only a live input has one" in out


def test_stamp_writes_the_contract_without_samples(cli, live, tmp_path):
    output = tmp_path / "stamped.onnx"
    status, out, error = cli("stamp", live, "-o", output)
    assert status == 0, error
    assert "golden vectors: none" in out
    metadata = read_header(output)[0]
    assert STAMP_KEY in metadata
    assert GOLDEN_KEY not in metadata
    assert dict(load_checkpoint(output).contract.live_inputs) == {"foot_contact": 2}


def test_play_says_who_must_feed_it_and_refuses_to_start_where_nobody_does(live, robot, capsys):
    options = ["--policy", str(live), "--robot", str(robot.mjcf_path), "--html", "none", "--record", "none"]
    assert run_program(play, options) == 1
    printed = capsys.readouterr().out
    assert "the policy observes foot_contact (/foot_contact), which a program has to send" in printed
    refusal = "START_LOCOMOTION refused: the live input 'foot_contact' (/foot_contact) has not come yet"
    assert f"failed: the automatic script: {refusal}" in " ".join(printed.split())
    assert "LOCOMOTION │" not in printed
