"""`record export`: what other programs find in its files."""

import csv
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.record import main as record_main
from humanoid_sim.recording.reader import open_recording

record = partial(run_program, record_main)
RECORDINGS = Path(__file__).parent / "data" / "recordings"
SIMULATED, HARDWARE = (RECORDINGS / f"{name}.mcap" for name in ("simulated_locomotion", "hardware_reactivated"))


@pytest.mark.parametrize("recording", [SIMULATED, HARDWARE], ids=["simulated", "hardware"])
def test_a_table_has_a_row_for_each_tick(recording, tmp_path):
    ticks = list(open_recording(recording).ticks())
    assert record(["export", str(recording), "--csv", str(tmp_path / "run.csv")]) == 0
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
    assert record(["export", str(SIMULATED), *words]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"error: {problem.replace('{}', str(tmp_path))}")
    assert line.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["there.csv"]
