"""`play --hardware` on emulated motors in this process: from the list of checks to the last frame."""

import io
import sys
from contextlib import ExitStack

import pytest
from rich.console import Console

from humanoid_sim.hardware.mock import robstride_motor
from humanoid_sim.hardware.robstride.firmware import emulated_version
from humanoid_sim.play.hardware_robot import HardwareSetup
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.robots.description import load_robot

HARDWARE = ("--hardware", "virtual:play", "--allow-script")
PLACEHOLDER = ("--policy", "placeholder")


def test_a_dry_run_enables_nothing_and_leaves_nothing(run, quick, told):
    result = run("--robot", quick, "--hardware", "virtual:dry", "--dry-run", *PLACEHOLDER, record=False)
    assert (result.status, result.err) == (0, "")
    assert result.out.count("\nok ") == 14  # a line for each motor
    assert "dry run: everything but enabling was done; no motor was enabled" in result.out
    assert list(result.folder.iterdir()) == []
    assert not [text for text in told if "enabled" in text]
    assert run("--robot", quick, *HARDWARE, "--script", "hold 0.1", *PLACEHOLDER).status == 0
    assert len([text for text in told if "enabled" in text]) == 14  # so they would have told


def test_firmware_that_no_document_mentions_is_a_question(run, quick, monkeypatch):
    monkeypatch.setattr(robstride_motor, "emulated_version", lambda model: (*emulated_version(model)[:3], 32))
    dry = run("--robot", quick, "--hardware", "virtual:dry", "--dry-run", *PLACEHOLDER, record=False)
    assert dry.status == 0
    questions = [line for line in dry.out.splitlines() if line.startswith("question")]
    assert len(questions) == 14
    assert all(".32: no document mentions it: --accept-firmware 0." in question for question in questions)
    assert dry.out.count("\nok ") == 14
    refused = run("--robot", quick, *HARDWARE, "--script", "hold 0.1", *PLACEHOLDER)
    assert (refused.status, refused.err) == (2, "error: lite: not enabled: the checks on standard output say why\n")
    assert "ZERO_TORQUE" not in refused.out
    assert list(refused.folder.iterdir()) == []
    accepted = {line.split("--accept-firmware ")[1].split()[0] for line in questions}
    options = ["--accept-firmware", *accepted]
    assert run("--robot", quick, *HARDWARE, "--script", "hold 0.1", *options, *PLACEHOLDER).status == 0


@pytest.mark.parametrize(("answer", "enables"), [("", False), ("n", False), ("yes", True)])
def test_real_motors_are_enabled_on_a_yes_only(answer, enables, monkeypatch, capsys):
    config = PlayConfig(hardware="udp_multicast:239.74.163.9", calibration="none")
    setup = HardwareSetup(config, load_robot("lite"), 0.02, ExitStack())
    monkeypatch.setattr(setup.robot, "prepare", lambda: setup.robot.checks.warn("can0", "no active reports"))
    terminal = io.StringIO(f"{answer}\n")
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", terminal)
    assert setup.bring_up(config, Console()) is enables
    out = capsys.readouterr().out
    assert out.index("warning  can0  no active reports") < out.index("Enable the motors of lite on ")


def test_where_nobody_can_be_asked_a_yes_must_be_given(run, quick, calibrate):
    calibrate(0.1)
    without = ("--no-gamepad", *PLACEHOLDER)
    result = run("--robot", quick, "--hardware", "can7", *without, record=False)
    assert result.status == 2
    assert result.err.startswith("error: --yes: is needed where nobody can be asked")
    result = run("--robot", quick, "--hardware", "can7", "--yes", *without)
    assert result.status == 2  # there is no such interface
    plain = run("--robot", quick, "--hardware", "can7", "--yes", "--calibration", "none", *without)
    assert "no calibration: the motors' zeros are taken for the joints'" in plain.out
    assert "calibration calibration.yaml" in result.out
    assert "no person has confirmed the direction (hardware identify) of left_shoulder_pitch, " in result.out
    assert "can7" in next(line for line in result.out.splitlines() if line.startswith("problem"))
