"""A contract with a live input is checked, shown and stamped without samples; programs that cannot feed it say so."""

import json

import pytest
from trainer import contract, save_checkpoint, terms

from humanoid_sim.cli import run_program
from humanoid_sim.controllers.contract import Term
from humanoid_sim.play import main as play
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.onnx_policy import read_header
from humanoid_sim.policy.readers.own import GOLDEN_KEY


@pytest.fixture
def live(tmp_path):
    """The trainer's policy, with two values of a sensor of its own in the place of a clock's."""
    observed = [Term("foot_contact", width=2) if term.name == "sin_phase" else term for term in terms()]
    return save_checkpoint(tmp_path / "live.onnx", contract(observation=observed))


@pytest.fixture
def file(tmp_path):
    """Writes a contract.yaml with these terms."""

    def write(text):
        (tmp_path / "live.yaml").write_text(f"terms: {{{text}}}\n", encoding="utf-8")
        return tmp_path / "live.yaml"

    return write


def test_it_is_checked_shown_and_stamped_without_samples(cli, live, robot, file, tmp_path):
    status, out, error = cli("check", live, "--robot", robot.mjcf_path)
    assert status == 0, error
    assert "observation term foot_contact: is a live input of width 2" in out
    options = file("foot_contact: {topic: /feet, timeout: .inf}")
    shown = json.loads(cli("show", live, "--contract", options, "--json")[1])
    (term,) = [term for term in shown["terms"] if term["name"] == "foot_contact"]
    assert term["words"] == "live input; from other programs by /feet, never stale"
    output = tmp_path / "stamped.onnx"
    status, out, error = cli("stamp", live, "-o", output)
    assert status == 0, error
    assert "golden vectors: none" in out
    assert GOLDEN_KEY not in read_header(output)[0]
    assert dict(load_checkpoint(output).contract.live_inputs) == {"foot_contact": 2}


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("topic: /tf", "live input 'foot_contact': its topic is /tf, which a session uses itself"),
        ("topic: feet", "topic: is feet, expected a ROS 2 name such as"),
        ("timeout: -1", "timeout: is -1.0, expected seconds > 0, or .inf"),
    ],
)
def test_declarations_that_are_refused(live, file, options, problem, robot, capsys):
    options = file(f"foot_contact: {{{options}}}")
    assert run_program(play, ["--policy", str(live), "--robot", str(robot.mjcf_path), "--contract", str(options)]) == 2
    error = capsys.readouterr().err
    assert problem in error
    assert error.count("\n") == 1


def test_the_width_may_come_from_a_contract_file(cli, file, tmp_path, robot):
    plain = save_checkpoint(tmp_path / "plain.onnx", contract(observation=[*terms()[:-2], "foot", "cos_phase"]))
    status, out, _ = cli("check", plain, "--robot", robot.mjcf_path)
    assert status == 1
    assert "a width declares a live input: {name: foot, width: 2}" in out
    assert cli("check", plain, "--robot", robot.mjcf_path, "--contract", file("foot: {width: 2}"))[0] == 0


def test_play_says_who_must_feed_it_and_refuses_to_start_where_nobody_does(live, robot, capsys):
    options = ["--policy", str(live), "--robot", str(robot.mjcf_path), "--html", "none", "--record", "none"]
    assert run_program(play, options) == 1
    printed = capsys.readouterr().out
    assert "the policy observes foot_contact (/foot_contact), which a program has to send" in printed
    refusal = "START_LOCOMOTION refused: the live input 'foot_contact' (/foot_contact) has not come yet"
    assert f"failed: the automatic script: {refusal}" in " ".join(printed.split())
    assert "LOCOMOTION │" not in printed
