"""A run that cannot be as it was asked for ends with one line and status 2, before anything is written or moved."""

from pathlib import Path

import pytest
from session_surface import play

PLACEHOLDER = ("--policy", "placeholder")
REFUSED = {
    "a policy that does not exist": ("no.onnx", "--policy", "no.onnx"),
    "an unknown policy": ("lite_trackin", "--policy", "lite_trackin"),
    "an unknown robot": ("atlas", "--robot", "atlas"),
    "a motion that does not exist": ("no.mcap", "--motion", "no.mcap"),
    "a command of one number": ("--command", "--robot", "lite_biped", "--command", "0.5"),
    "a command that is no number": ("--command", "--robot", "lite_biped", "--command", "0.5,x,0"),
    "a negative duration": ("-1", *PLACEHOLDER, "--script", "damp; hold 1", "--duration", "-1"),
    "a recording that is no .mcap": ("run.txt", *PLACEHOLDER, "--record", "run.txt"),
    "a recording that exists": ("kept.mcap", *PLACEHOLDER, "--record", "kept.mcap"),
    "an unknown word in a script": ("jump", *PLACEHOLDER, "--script", "damp; jump"),
    "a watchdog without a time": ("lidar", *PLACEHOLDER, "--watchdog", "lidar"),
    "keys without a terminal": ("--manual", *PLACEHOLDER, "--manual"),
    "a script on hardware": ("--allow-script", *PLACEHOLDER, "--hardware", "virtual:a", "--script", "damp"),
    "a calibration that does not exist": (
        "no.yaml",
        *PLACEHOLDER,
        "--hardware",
        "virtual:a",
        "--calibration",
        "no.yaml",
    ),
    "a real bus without a gamepad": ("--no-gamepad", "--hardware", "can7", "--yes", "--calibration", "none"),
    "a real bus that is not there": ("can7", "--hardware", "can7", "--yes", "--calibration", "none", "--no-gamepad"),
}
"""What the line must name, and the command line."""


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_one_line_and_status_2_and_leaves_nothing_behind(name, quick):
    named, *arguments = REFUSED[name]
    Path("kept.mcap").write_bytes(b"mine")
    run = play(*arguments)
    assert run.status == 2
    assert named in run.err or named in run.out
    assert len(run.err.splitlines()) == 1
    assert [path.name for path in Path().iterdir()] == ["kept.mcap"]
    assert Path("kept.mcap").read_bytes() == b"mine"


def test_a_real_bus_is_driven_without_a_gamepad_only_where_that_is_said(quick):
    bus = ("--hardware", "can7", "--yes", "--calibration", "none")
    assert "gamepad" in play(*bus).err
    assert "gamepad" not in play(*bus, "--no-gamepad").err
