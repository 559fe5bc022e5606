"""That every stage runs, is resumed, and ends in a checkpoint; how well it walks is the shipped one's business."""

import json

import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.files import exclusive_folder
from humanoid_sim.policy.checkpoint import load_checkpoint
from tools.samples import main

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from tools.samples.walking.stages import STAGES

pytestmark = pytest.mark.slow


def test_all_stages_run_and_are_resumed(tmp_path, capsys):
    output, folder = tmp_path / "walk.onnx", tmp_path / "run"
    arguments = ["train-walking", "--quick", "--output", str(output), "--folder", str(folder)]
    assert main(arguments) == 0
    assert output.is_file()
    stages = [path.stem for path in folder.glob("*.zip")]
    assert sorted(stages) == sorted(["latest", *(stage.name for stage in STAGES)])
    assert json.loads((folder / "latest.json").read_text())["stage"] == "mean"
    contract = asset_path("policies", "lite_biped_velocity.contract.yaml")
    assert load_checkpoint(output, contract).contract.action_count == 14
    capsys.readouterr()
    assert run_program(main, arguments) == 2
    assert "has a checkpoint; --resume goes on from it" in capsys.readouterr().err
    (folder / "latest.json").write_text(json.dumps({"stage": "go", "steps": 32}))
    assert main([*arguments, "--resume"]) == 0
    assert "goes on in stage 'go' after 32 steps" in capsys.readouterr().err
    (folder / "latest.json").write_text(json.dumps({"stage": "fly", "steps": 32}))
    assert run_program(main, [*arguments, "--resume"]) == 2
    assert "stage is 'fly', expected one of step, stay up, go, hold a speed, spare" in capsys.readouterr().err
    for damaged in ('{"stage": "go"', "[]", '{"stage": "go", "steps": "many"}'):
        (folder / "latest.json").write_text(damaged)
        assert run_program(main, [*arguments, "--resume"]) == 2
        assert f"error: --resume: '{folder / 'latest.json'}' is damaged, or holds" in capsys.readouterr().err
    (folder / "latest.json").write_text(json.dumps({"stage": "go", "steps": 0}))
    (folder / "latest.zip").write_bytes((folder / "latest.zip").read_bytes()[:-1000])
    assert run_program(main, [*arguments, "--resume"]) == 2
    assert f"error: --resume: '{folder / 'latest.zip'}' is damaged, or holds" in capsys.readouterr().err
    with exclusive_folder(folder, "--folder"):
        assert run_program(main, [*arguments, "--resume"]) == 2
    assert f"error: --folder: '{folder}' is being written by another session" in capsys.readouterr().err
