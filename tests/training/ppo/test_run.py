"""A training from its first step to a policy that plays: killed on the way, and resumed."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.play import main as play
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.training import main
from humanoid_sim.training.ppo.journal import read_progress

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("rsl_rl")
pytest.importorskip("tensorboard")

pytestmark = pytest.mark.slow

_PATIENCE = 180.0
"""s, for a machine on which much else runs."""


def killed_after_a_checkpoint(options: list[str], folder: Path, checkpoint: str) -> None:
    """Start a training that would never end, and kill it when a second checkpoint has been written."""
    command = [sys.executable, "-m", "humanoid_sim.training", "train", *options, "--checkpoint-seconds", "0.01"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
    assert process.stderr is not None
    try:
        deadline, first = time.monotonic() + _PATIENCE, None
        while time.monotonic() < deadline:
            path = folder / checkpoint
            if path.exists():
                first = first or path.stat().st_mtime_ns
                if path.stat().st_mtime_ns != first:
                    break
            assert process.poll() is None, process.stderr.read().decode()
            time.sleep(0.05)
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
    assert first is not None


@pytest.mark.parametrize(
    ("algorithm", "checkpoint", "subject"),
    [
        ("ppo-sb3", "checkpoint.zip", ["--robot", "lite", "--motion", "reach"]),
        ("ppo-rsl_rl", "checkpoint.pt", ["--robot", "lite_biped", "--privileged", "base_linear_velocity"]),
    ],
)
def test_train_kill_resume_export_play(
    algorithm: str, checkpoint: str, subject: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder, options = tmp_path / "run", [*subject, "--algorithm", algorithm, "--robots", "16"]
    options += ["--physics-timestep", "0.005", "--folder", str(folder)]
    killed_after_a_checkpoint([*options, "--steps", "100000000"], folder, checkpoint)
    assert not (folder / "policy.onnx").exists()
    before = [row["steps"] for row in read_progress(folder / "progress.csv")]
    assert len(before) >= 2

    output = tmp_path / "policy.onnx"
    ends = int(before[-1]) + 2048
    options += ["--steps", str(ends), "--output", str(output)]
    assert run_program(main, ["train", *options]) == 2
    assert "has a run; --resume goes on with it" in capfd.readouterr().err
    assert main(["train", *options, "--resume", "--no-regress"]) == 0
    told = capfd.readouterr()
    (line,) = [line for line in told.err.splitlines() if line.startswith("goes on after ")]
    saved = int(line.split()[3])
    assert saved in before
    assert f"{output}: " in told.out
    rows = read_progress(folder / "progress.csv")
    steps = [row["steps"] for row in rows]
    assert steps == sorted(set(steps))
    assert steps[-1] >= ends
    assert all(np.isfinite(row["spread"]) for row in rows)
    assert list((folder / "tensorboard").glob("events.out.tfevents.*"))

    loaded = load_checkpoint(output)
    assert "trainer" in loaded.golden
    motion = ["--motion", "reach"] if "lite" in subject else []
    summary = tmp_path / "summary.json"
    quick = ["--pace", "fast", "--video", "none", "--viewer", "none", "--policy-seconds", "0.2"]
    robot = subject[1]
    assert play(["--policy", str(output), "--robot", robot, *motion, *quick, "--summary", str(summary)]) == 0
    assert json.loads(summary.read_text())


def test_a_finished_run_is_only_exported_again_and_measured(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    options = ["--robots", "8", "--steps", "512", "--folder", str(folder), "--no-tensorboard", "--motion", "wave"]
    assert main(["train", *options, "--no-regress"]) == 0
    first = (folder / "policy.onnx").read_bytes()
    rows = (folder / "progress.csv").read_text()
    assert rows.count("\n") == 3
    assert main(["train", *options, "--resume"]) == 0
    assert (folder / "progress.csv").read_text() == rows
    assert len((folder / "policy.onnx").read_bytes()) == len(first)
    known = json.loads((folder / "regress.json").read_text())
    assert "lite_tracking" in json.dumps(known["suite"])
    assert not (folder / "tensorboard").exists()
    assert "wave" in capfd.readouterr().out
