"""What `record dataset` refuses before it needs `lerobot`; tests/lerobot has the rest."""

import sys
from pathlib import Path

from humanoid_sim.cli import run_program
from humanoid_sim.record import main

RECORDING = Path(__file__).parent / "data" / "recordings" / "simulated_locomotion.mcap"


def refusal(capsys, *arguments):
    assert run_program(main, ["dataset", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_options_that_make_no_sense(tmp_path, capsys):
    output = str(tmp_path / "set")
    assert "gone.mcap: no such file" in refusal(capsys, "gone.mcap", "-o", output)
    assert "--fps: is 0, expected at least 1" in refusal(capsys, "gone.mcap", "-o", output, "--fps", "0")
    for folder in (tmp_path, tmp_path / "a" / "b"):
        assert "expected a new folder in one that exists" in refusal(capsys, "gone.mcap", "-o", str(folder))


def test_without_lerobot(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "lerobot", None)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    error = refusal(capsys, str(RECORDING), "-o", str(tmp_path / "set"))
    assert "needs the package 'lerobot', which is not installed: pip install 'humanoid_sim[lerobot]'" in error
    assert not (tmp_path / "set").exists()
