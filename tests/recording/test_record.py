"""`record` as a user meets it: `info`, `export`, and what `dataset` refuses before it needs `lerobot`."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_run import COUNT, PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.record import main
from humanoid_sim.recording.reader import open_recording

RECORDINGS = Path(__file__).parents[1] / "data" / "recordings"
SIMULATED, HARDWARE = (RECORDINGS / f"{name}.mcap" for name in ("simulated_locomotion", "hardware_reactivated"))


def record(*arguments):
    return run_program(main, arguments)


def refusal(capsys, *arguments):
    assert record(*arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "140")
    header, ticks = wobbled()
    ticks = [replace(ticks[0], overrun=True), *ticks[1:]]
    write_recording(tmp_path / "run.mcap", ticks, header, events=[(3.5, "the support let go")])
    return tmp_path / "run.mcap"


def test_info_as_json(path, capsys):
    assert record("info", str(path), "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["robot"], info["damage"]) == ("lite", "")
    assert (info["ticks"], info["missing_ticks"], info["overruns"], info["inferences"]) == (COUNT, 0, 1, 21)
    modes = ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING", "STANDBY", "REMOTE", "DAMPING"]
    assert [span["mode"] for span in info["modes"]] == modes
    assert info["modes"][3]["start"] == pytest.approx(210 * PERIOD)
    assert [len(info[kind]) for kind in ("events", "faults", "refusals", "safety")] == [1, 1, 1, 1]
    assert info["safety"][0]["message"] == "safety FAULT RX_TIMEOUT from can0: wrist"


def test_info_for_a_person(path, capsys):
    assert record("info", str(path)) == 0
    out = capsys.readouterr().out
    for text in ("lite, 14 joints", "560 at 50 Hz, 1 overruns", "START_LOCOMOTION", "the support let go", " of 14 "):
        assert text in out
    path.write_bytes(path.read_bytes()[:-60])
    assert record("info", str(path)) == 0
    assert "not complete: cut" in capsys.readouterr().out


@pytest.mark.parametrize("recording", [SIMULATED, HARDWARE], ids=["simulated", "hardware"])
def test_a_table_has_a_row_for_each_tick(recording, tmp_path):
    ticks = list(open_recording(recording).ticks())
    assert record("export", str(recording), "--csv", str(tmp_path / "run.csv")) == 0
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(ticks)
    for row, tick in zip(rows, ticks, strict=True):
        assert float(row["time"]) == tick.input.state.time
        assert float(row["position/left_elbow_pitch"]) == tick.input.state.joint_position[3]
        assert float(row["command_damping/right_wrist_pitch"]) == tick.output.command.damping[13]
        assert row["mode"] == str(int(tick.output.control_mode.mode))
        step = tick.output.policy_step
        if "action/left_elbow_pitch" in row:
            action = np.nan if step is None else float(step.action[3])
            assert float(row["action/left_elbow_pitch"]) == pytest.approx(action, abs=0.0, nan_ok=True)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ([], "record export: expected --csv, --html or --mp4, each with a file to write"),
        (["--csv", "{}/run.txt"], "--csv: is '{}/run.txt', expected a name that ends in .csv"),
        (["--csv", "{}/there.csv"], "--csv: '{}/there.csv' exists; choose another name, or add --overwrite"),
        (["--html", "{}/a.html", "--robot", "lite_biped"], "--robot: 'lite_biped' has other joints than the robot of "),
    ],
)
def test_what_cannot_be_written_is_one_line(options, problem, tmp_path, capsys):
    (tmp_path / "there.csv").write_text("kept")
    words = [word.replace("{}", str(tmp_path)) for word in options]
    assert problem.replace("{}", str(tmp_path)) in refusal(capsys, "export", str(SIMULATED), *words)
    assert [file.name for file in tmp_path.iterdir()] == ["there.csv"]


def test_a_dataset_that_cannot_be_made_is_one_line(tmp_path, capsys):
    output = str(tmp_path / "set")
    assert "gone.mcap: no such file" in refusal(capsys, "dataset", "gone.mcap", "-o", output)
    assert "--fps: is 0, expected at least 1" in refusal(capsys, "dataset", "gone.mcap", "-o", output, "--fps", "0")
    for folder in (tmp_path, tmp_path / "a" / "b"):
        assert "expected a new folder in one that exists" in refusal(capsys, "dataset", "gone.mcap", "-o", str(folder))


def test_a_dataset_needs_lerobot(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "lerobot", None)
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    error = refusal(capsys, "dataset", str(SIMULATED), "-o", str(tmp_path / "set"))
    assert "needs the package 'lerobot', which is not installed: pip install 'humanoid_sim[lerobot]'" in error
    assert not (tmp_path / "set").exists()
