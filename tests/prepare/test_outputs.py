"""Where `prepare` takes its checkpoint from, and what it copies."""

import sys

from fake_wandb import File, Service
from motion_samples import write_npz

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.prepare import main

POLICY = asset_path("policies", "lite_tracking.onnx")


def test_a_run_s_checkpoint(tmp_path, monkeypatch, capsys):
    service = Service()
    service.add("lab/arms/7xk2").inside.append(File("model_300.onnx", POLICY.read_bytes(), service))
    monkeypatch.setitem(sys.modules, "wandb", service.module())
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    motion = write_npz(tmp_path / "dance.npz")
    arguments = ["--wandb-run-path", "lab/arms/7xk2", "--motion", str(motion), "--output", str(tmp_path / "out")]
    assert run_program(main, arguments) == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["dance.json", "dance.mcap", "model_300.onnx"]
    assert (tmp_path / "out" / "model_300.onnx").read_bytes() == POLICY.read_bytes()
    service.fails = ConnectionError()
    assert run_program(main, [*arguments, "--overwrite"]) == 2
    assert "fetched before: model_300.onnx" in capsys.readouterr().err
    assert run_program(main, [*arguments, "--overwrite", "--wandb-file", "model_300.onnx"]) == 0
    assert "is the copy in" in capsys.readouterr().out


def test_no_checkpoint(capsys):
    assert run_program(main, ["--motion", "dance.npz"]) == 2
    assert "--policy and --wandb-run-path: neither is given" in capsys.readouterr().err


def test_the_contract_yaml_goes_with_the_checkpoint(tmp_path):
    source = tmp_path / "trained"
    source.mkdir()
    (source / "arms.onnx").write_bytes(POLICY.read_bytes())
    (source / "contract.yaml").write_text("override: {action_clip: 5.0}\n")
    motion = write_npz(tmp_path / "dance.npz")
    arguments = ["--policy", str(source / "arms.onnx"), "--motion", str(motion), "--output", str(tmp_path / "out")]
    assert run_program(main, arguments) == 0
    assert (tmp_path / "out" / "arms.contract.yaml").read_text() == "override: {action_clip: 5.0}\n"


def test_lerobot_and_its_dataset_are_only_needed_for_one(monkeypatch, capsys, tmp_path):
    """Without --motion it is the checkpoint's own dataset; without lerobot that is one line."""
    monkeypatch.setitem(sys.modules, "lerobot", None)
    assert run_program(main, ["--policy", str(POLICY), "--output", str(tmp_path / "out")]) == 2
    captured = capsys.readouterr()
    assert "motion: the dataset local/lite_sample_motions that the checkpoint names" in captured.out
    assert "needs the package 'lerobot', which is not installed" in captured.err
