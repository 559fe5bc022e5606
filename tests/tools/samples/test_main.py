import json
import sys

import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import Motion, read_motion, write_motion
from tools.samples import main


def test_motions_are_written_to_a_new_folder(tmp_path, capsys):
    assert main(["motions", "--output", str(tmp_path / "new")]) == 0
    assert "wave.mcap: 401 frames, 8 s" in capsys.readouterr().out
    assert len(list((tmp_path / "new").iterdir())) == 4
    assert read_motion(tmp_path / "new" / "wave.mcap").duration == pytest.approx(8.0)


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    assert run_program(main, ["motions", "--output", str(tmp_path / "taken")]) == 2
    assert "taken: cannot be made a folder" in capsys.readouterr().err


def test_evaluate_prints_a_table_and_writes_json(tmp_path, capsys):
    wave = str(asset_path("motions", "wave.mcap"))
    assert main(["evaluate", "--motion", wave, "--json", str(tmp_path / "figures.json")]) == 0
    assert "wave" in capsys.readouterr().out
    policy, baseline = json.loads((tmp_path / "figures.json").read_text())
    assert (policy["policy"], baseline["policy"]) == ("policy", "ik")
    assert policy["position_rms"] < baseline["position_rms"]
    assert 0.5 < policy["peak_hand_speed"] < 1.0


def test_evaluate_names_a_missing_file(capsys):
    assert run_program(main, ["evaluate", "--policy", "no.onnx"]) == 2
    assert "no.onnx: no such file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--motions", "0"], "--motions: is 0, expected at least 1"),
        (["--seed", "-1"], "--seed: is -1, expected at least 0"),
        (["--output", "no/where.onnx"], "--output: the folder 'no' does not exist"),
        (["--output", "."], "--output: '.' is a directory, expected a file name"),
    ],
)
def test_training_refuses_what_would_stop_it_later(options, message, capsys):
    pytest.importorskip("torch")
    assert run_program(main, ["train-sample", "--quick", *options]) == 2
    assert message in capsys.readouterr().err


def test_evaluate_refuses_a_motion_of_other_bodies(tmp_path, capsys):
    wave = read_motion(asset_path("motions", "wave.mcap"))
    renamed = ("head", *wave.body_names[1:])
    write_motion(tmp_path / "other.mcap", Motion(wave.frames, renamed, wave.policy_dt, "tracking", "lite"))
    assert run_program(main, ["evaluate", "--motion", str(tmp_path / "other.mcap")]) == 2
    assert "other: motion: describes the bodies head, left_hand" in capsys.readouterr().err


def test_training_without_pytorch_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in [name for name in sys.modules if name.startswith("tools.samples.")]:
        if name.rsplit(".", 1)[1] in ("train", "student", "statics", "closed_loop"):
            monkeypatch.delitem(sys.modules, name)
    assert run_program(main, ["train-sample", "--output", "unused.onnx"]) == 2
    assert "pip install 'humanoid_sim[train]'" in capsys.readouterr().err


def test_quick_training_runs_from_nothing_to_a_checkpoint(tmp_path, capsys):
    pytest.importorskip("torch")
    path = tmp_path / "quick.onnx"
    assert main(["train-sample", "--quick", "--threads", "1", "--output", str(path)]) == 0
    checkpoint = load_checkpoint(path)
    assert checkpoint.contract.action_count == 14
    assert np.isfinite(checkpoint.policy(np.zeros(78, dtype=np.float32), 0)).all()
