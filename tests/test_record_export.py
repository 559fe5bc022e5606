"""`record export`: what other programs find in its files."""

import csv
import shutil
import subprocess
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.record import main as record_main
from humanoid_sim.recording.reader import open_recording

record = partial(run_program, record_main)
RECORDINGS = Path(__file__).parent / "data" / "recordings"
SIMULATED, HARDWARE = (RECORDINGS / f"{name}.mcap" for name in ("simulated_locomotion", "hardware_reactivated"))


@pytest.mark.parametrize("recording", [SIMULATED, HARDWARE], ids=["simulated", "hardware"])
def test_a_table_has_a_row_for_each_tick(recording, tmp_path, capsys):
    ticks = list(open_recording(recording).ticks())
    assert record(["export", str(recording), "--csv", str(tmp_path / "run.csv")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'run.csv'}: {len(ticks)} ticks\n"
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(ticks)
    for row, tick in zip(rows, ticks, strict=True):
        assert float(row["time_s"]) == tick.input.state.time
        assert row["mode"] == tick.output.control_mode.mode.name
        assert float(row["position/left_elbow_pitch"]) == tick.input.state.joint_position[3]
        assert float(row["command_damping/right_wrist_pitch"]) == tick.output.command.damping[13]
        step = tick.output.policy_step
        assert row["policy_frame"] == ("" if step is None else str(step.frame))
        if step is not None and "action/left_elbow_pitch" in row:
            assert float(row["action/left_elbow_pitch"]) == step.action[3]


@pytest.mark.peers
def test_the_rerun_viewer_gets_robot_and_plots(tmp_path):
    if find_spec("rerun") is None:
        pytest.skip("rerun-sdk is not installed")
    # In a process of its own: the library keeps sockets open until its process ends.
    words = [
        sys.executable,
        "-m",
        "humanoid_sim.record",
        "export",
        str(SIMULATED),
        "--rerun",
        str(tmp_path / "run.rrd"),
    ]
    subprocess.run(words, check=True)
    assert (tmp_path / "run.rrd").stat().st_size > 50_000
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]
    tool = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert tool is not None
    shown = subprocess.run(
        [tool, "rrd", "print", "-v", str(tmp_path / "run.rrd")], capture_output=True, text=True, check=True
    )
    for part in ("/plots/position", "/plots/command", "left_hand", "/transforms/"):
        assert part in shown.stdout


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ([], "record export: expected --urdf, --csv, --html, --mp4 or --rerun, each with a file to write"),
        (["--csv", "{}/run.txt"], "--csv: is '{}/run.txt', expected a name that ends in .csv"),
        (["--csv", "{}/there.csv"], "--csv: '{}/there.csv' exists; choose another name, or add --overwrite"),
        (["--urdf", "{}/a.urdf", "--robot", "lite_biped"], "--robot: 'lite_biped' has other joints than the robot of "),
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
