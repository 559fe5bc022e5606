import dataclasses
import json
import re

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_folder
from humanoid_sim.training import main
from humanoid_sim.training.ppo import run
from humanoid_sim.training.ppo.journal import COLUMNS
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.run import RunFolder

SUBJECT = {"task": "tracking", "contract": "lite_tracking", "motion": "wave"}


def folder(path, config=None, **subject):
    path.mkdir(parents=True, exist_ok=True)
    return RunFolder(path, config or TrainConfig(), {**SUBJECT, **subject}, ".zip")


def test_a_run_is_begun_and_resumed(tmp_path):
    path = tmp_path / "deep" / "run"
    new = folder(path)
    assert (new.is_resumed, new.start) == (False, None)
    known = json.loads((path / "run.json").read_text())
    assert (known["robot"], known["task"], known["ppo"]["gamma"]) == ("lite", "tracking", 0.99)
    assert folder(path, TrainConfig(resume=True)).start is None  # it ended before its first checkpoint
    new.checkpoint.write_bytes(b"network")
    (path / "progress.csv").write_text(",".join(COLUMNS) + "\n2048,7.5,300,1,50,1,0.4\n")
    resumed = folder(path, TrainConfig(resume=True, steps=5, minutes=1.0, tensorboard=False))
    assert resumed.start == path / "checkpoint.zip"
    assert (len(resumed.rows), resumed.seconds) == (1, 7.5)
    assert sorted(file.name for file in path.iterdir()) == ["checkpoint.zip", "progress.csv", "run.json"]


def test_a_run_is_neither_overwritten_nor_mixed_with_another(tmp_path, monkeypatch):
    folder(tmp_path)
    with pytest.raises(InputError, match="has a run; --resume goes on with it, another folder begins"):
        folder(tmp_path)
    with pytest.raises(InputError, match=r"--robots: is 7, but the run in '.*' has 128; --resume keeps it"):
        folder(tmp_path, TrainConfig(resume=True, robots=7))
    with pytest.raises(InputError, match=r"--task: is 'balance', but the run in '.*' has 'tracking'"):
        folder(tmp_path, TrainConfig(resume=True), task="balance")
    monkeypatch.setattr(run, "SETTINGS", dataclasses.replace(run.SETTINGS, gamma=0.5))
    with pytest.raises(InputError, match=r"PPO's settings: is .*0.5.*, but the run in"):
        folder(tmp_path, TrainConfig(resume=True))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[", "cannot be read: Expecting value"),
        ("[" * 100_000, "cannot be read: is nested too deeply"),
        ("[]", "cannot be read: is a list, expected an object"),
        ('"curriculum_steps": "many"}', "curriculum_steps is 'many', expected a whole number > 0"),
        ('"curriculum_steps": -1}', "curriculum_steps is -1, expected a whole number > 0"),
    ],
)
def test_a_damaged_run_is_one_line(text, told, tmp_path):
    folder(tmp_path, curriculum_steps=5000)
    place = tmp_path / "run.json"
    known = place.read_text()
    place.write_text(known[: known.index('"curriculum_steps"')] + text if "curriculum" in text else text)
    with pytest.raises(InputError, match=rf"run\.json: {re.escape(told)}"):
        folder(tmp_path, TrainConfig(resume=True), curriculum_steps=None)


def test_a_curriculum_goes_on_as_it_was(tmp_path):
    new = RunFolder(tmp_path, TrainConfig(), {**SUBJECT, "curriculum_steps": 5000}, ".zip")
    assert new.curriculum_steps == 5000
    again = TrainConfig(resume=True, steps=9_000_000)
    assert RunFolder(tmp_path, again, {**SUBJECT, "curriculum_steps": None}, ".zip").curriculum_steps == 5000
    with pytest.raises(InputError, match=r"--curriculum-steps: is 6000, but the run in '.*' has 5000; --resume keeps"):
        RunFolder(tmp_path, again, {**SUBJECT, "curriculum_steps": 6000}, ".zip")


def test_a_folder_has_one_training_at_a_time(tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    new = tmp_path / "new"
    assert run_program(main, ["train", "--resume", "--folder", str(new)]) == 2
    assert "has no run to go on with, expected a folder of `train`" in capsys.readouterr().err
    assert not new.exists()
    with exclusive_folder(new, "--folder"):
        assert run_program(main, ["train", "--folder", str(new)]) == 2
        folder(new)
        assert run_program(main, ["train", "--resume", "--folder", str(new)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"error: --folder: '{new}' is being written by another session; choose another name"] * 2
