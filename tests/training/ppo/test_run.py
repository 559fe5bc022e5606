"""A training from its first step to a policy that plays: killed on the way, and resumed."""

import base64
import io
import json
import math
import pickle
import re
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.play import main as play
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.training import main
from humanoid_sim.training.ppo.journal import read_progress

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("rsl_rl")
pytest.importorskip("tensorboard")

pytestmark = pytest.mark.slow

_PATIENCE = 180.0
"""s, for a machine on which much else runs."""


def killed_after_a_checkpoint(options, folder, checkpoint):
    """Start a training that would never end, and kill it when a second checkpoint has been written."""
    command = [sys.executable, "-m", "humanoid_sim.training", "train", *options, "--checkpoint-seconds", "0.01"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE)
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
def test_train_kill_resume_export_play(algorithm, checkpoint, subject, tmp_path, capfd):
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


def test_a_finished_run_is_only_exported_again_and_measured(tmp_path, capfd):
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


def test_minutes_that_are_used_up_are_no_training(tmp_path, capfd):
    folder = tmp_path / "run"
    options = ["--robots", "4", "--folder", str(folder), "--no-tensorboard", "--no-regress", "--minutes", "1e-6"]
    assert main(["train", *options]) == 0  # one update
    assert "making 4 robots lite for the task tracking …\n" in capfd.readouterr().err
    progress, policy = (folder / "progress.csv").read_text(), folder / "policy.onnx"
    assert progress.count("\n") == 2
    assert run_program(main, ["train", *options, "--resume"]) == 2
    line = capfd.readouterr().err.splitlines()[-1]
    told = r"error: --resume: the folder already has [0-9.]+ of --minutes 1e-06; give a larger --minutes \(earlier runs"
    assert re.match(told, line)
    assert (folder / "progress.csv").read_text() == progress
    policy.unlink()  # as if it had been killed before it wrote that
    assert main(["train", *options, "--resume"]) == 0
    assert "trainer" in load_checkpoint(policy).golden
    assert (folder / "progress.csv").read_text() == progress


class Trap:
    """Its pickle makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.parametrize("algorithm", ["ppo-sb3", "ppo-rsl_rl"])
def test_a_checkpoint_runs_nothing(algorithm, tmp_path, capfd):
    folder, ran = tmp_path / "run", tmp_path / "ran"
    options = ["train", "--robots", "4", "--no-tensorboard", "--no-regress", "--motion", "wave"]
    options += ["--algorithm", algorithm, "--folder", str(folder)]
    assert main([*options, "--steps", "128"]) == 0
    checkpoint = next(folder.glob("checkpoint.*"))
    sound = checkpoint.read_bytes()
    if algorithm == "ppo-sb3":
        with zipfile.ZipFile(checkpoint) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        pickled = {":serialized:": base64.b64encode(pickle.dumps(Trap(ran))).decode()}
        files["data"] = json.dumps(json.loads(files["data"]) | {"lr_schedule": pickled}).encode()
        with zipfile.ZipFile(checkpoint, "w") as archive:
            for name, content in files.items():
                archive.writestr(name, content)
        assert main([*options, "--steps", "256", "--resume"]) == 0  # goes on, and leaves that alone
        assert "goes on after 128 steps\n" in capfd.readouterr().err
        with zipfile.ZipFile(checkpoint, "w") as archive, archive.open("policy.pth", "w") as file:
            torch.save({"network": Trap(ran)}, file)
    else:
        known = torch.load(checkpoint, weights_only=True)
        torch.save(known | {"infos": Trap(ran)}, checkpoint)
    for damage in ("cut", "not finite", ""):
        assert run_program(main, [*options, "--steps", "512", "--resume"]) == 2
        line = capfd.readouterr().err.splitlines()[-1]
        assert line.startswith(f"error: --resume: '{checkpoint}' is damaged, or holds more than arrays and numbers")
        if damage == "cut":
            checkpoint.write_bytes(sound[:-1000])
        elif damage and algorithm == "ppo-sb3":
            with zipfile.ZipFile(checkpoint, "w") as archive:
                network = torch.load(io.BytesIO(files.pop("policy.pth")), weights_only=True)
                with archive.open("policy.pth", "w") as file:
                    torch.save({name: value * math.nan for name, value in network.items()}, file)
                for name, content in files.items():
                    archive.writestr(name, content)
        elif damage:
            known["optimizer_state_dict"]["state"][3]["exp_avg"] = torch.zeros(1, 2, 3)
            torch.save(known, checkpoint)
    assert not ran.exists()


HOLD = f"{Path(__file__).parents[3] / 'examples' / 'own_task.py'}:HoldTask"
TWO_MOTIONS = ["--motion", "wave", "--motion", "circle", "--reference-start", "0.5"]


@pytest.mark.parametrize("algorithm", ["ppo-sb3", "ppo-rsl_rl"])
def test_ground_that_grows_harder(algorithm, tmp_path, monkeypatch, capfd):
    told = []
    known = PolicyVectorEnv.progress
    assert known.fset is not None

    def tell(envs, progress):
        told.append(progress)
        known.fset(envs, progress)

    monkeypatch.setattr(PolicyVectorEnv, "progress", property(known.fget, tell))
    folder, harder = tmp_path / "run", tmp_path / "harder.yaml"
    harder.write_text("{terrain: [[0, 0], [1, 1]], randomisation: [[0.5, 0], [1, 1]]}")
    spread = tmp_path / "spread.yaml"
    spread.write_text("friction: [0.6, 1.2]")
    options = ["--robot", "lite_biped", "--terrain", "mixed", "--randomisation", str(spread), "--no-regress"]
    options += ["--curriculum", str(harder), "--algorithm", algorithm, "--robots", "8", "--no-tensorboard"]
    options += ["--physics-timestep", "0.005", "--folder", str(folder)]
    assert main(["train", *options, "--steps", "512", "--curriculum-steps", "1024"]) == 0
    assert told == [0.0, 0.25]
    assert "trainer" in load_checkpoint(folder / "policy.onnx").golden
    told.clear()
    assert main(["train", *options, "--steps", "768", "--resume"]) == 0
    assert told == [0.5]
    capfd.readouterr()
    harder.write_text("{terrain: 1.0}")
    assert run_program(main, ["train", *options, "--steps", "1024", "--resume"]) == 2
    assert "error: --curriculum: is {'terrain': 1.0}, but the run in" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("options", "task"),
    [
        ([*TWO_MOTIONS, "--task", HOLD, "--algorithm", "ppo-rsl_rl"], HOLD),
        (["--robot", "lite_piano", "--motion", "twinkle", "--motion", "ode_to_joy"], "piano"),
    ],
    ids=["own task", "piano"],
)
def test_tasks_and_motions(options, task, tmp_path):
    folder = tmp_path / "run"
    quick = ["--robots", "4", "--steps", "256", "--no-tensorboard", "--no-regress", "--folder", str(folder)]
    assert main(["train", *options, *quick]) == 0
    assert json.loads((folder / "run.json").read_text())["task"] == task
    assert "trainer" in load_checkpoint(folder / "policy.onnx").golden


def usual_signals():
    """Undo what the test runner may have inherited: a job in the background ignores SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def interrupted(options, folder, *, twice):
    """Start a training that would never end, and interrupt it after an update; exit status and standard error."""
    command = [sys.executable, "-m", "humanoid_sim.training", "train", *options, "--steps", "100000000"]
    command += ["--checkpoint-seconds", "100000", "--no-tensorboard", "--folder", str(folder)]
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=usual_signals,  # noqa: PLW1509 - no thread of the tests runs here
    )
    try:
        deadline, progress = time.monotonic() + _PATIENCE, folder / "progress.csv"
        while not (progress.exists() and progress.read_text().count("\n") >= 2):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        seen = ""
        if twice:
            while "once more ends at once" not in seen:
                line = process.stderr.readline()
                assert line, seen
                seen += line
            process.send_signal(signal.SIGINT)
        _, rest = process.communicate(timeout=_PATIENCE)
        return process.returncode, seen + rest
    finally:
        process.kill()
        process.wait()
        process.stderr.close()


@pytest.mark.parametrize(("algorithm", "checkpoint"), [("ppo-sb3", "checkpoint.zip"), ("ppo-rsl_rl", "checkpoint.pt")])
def test_ctrl_c_loses_nothing(algorithm, checkpoint, tmp_path, capfd):
    folder, options = tmp_path / "run", ["--motion", "wave", "--robots", "16", "--algorithm", algorithm]
    status, told = interrupted(options, folder, twice=False)
    assert status == 130
    assert "Ctrl-C: ends after this update, with a checkpoint; once more ends at once\n" in told
    assert f"saved in {folder}; the same command with --resume goes on\n" in told
    assert (folder / checkpoint).exists()
    assert not (folder / "policy.onnx").exists()
    last = int(read_progress(folder / "progress.csv")[-1]["steps"])
    assert f"interrupted after {last} steps" in told
    resumed = ["--steps", str(last + 1), "--no-tensorboard", "--no-regress", "--folder", str(folder), "--resume"]
    assert main(["train", *options, *resumed]) == 0
    assert f"goes on after {last} steps\n" in capfd.readouterr().err
    assert (folder / "policy.onnx").exists()


def test_a_second_ctrl_c_ends_at_once(tmp_path):
    # An update of so many robots takes seconds, and the second signal comes in the middle of it.
    status, told = interrupted(["--motion", "wave", "--robots", "256"], tmp_path / "run", twice=True)
    assert status == 130
    assert told.endswith("interrupted\n")
    assert "--resume" not in told
    assert not (tmp_path / "run" / "checkpoint.zip").exists()
