"""A run of `train` apart from the learning: its folder, its videos, Ctrl-C, and the measuring at its end."""

import dataclasses
import json
import re
import signal

import av
import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_folder
from humanoid_sim.training import main
from humanoid_sim.training.ppo import run
from humanoid_sim.training.ppo.environment import subject_of
from humanoid_sim.training.ppo.journal import COLUMNS
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.run import RunFolder, Videos, interruptible, measure

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


def test_measuring_is_announced_and_may_be_left_out(tmp_path, monkeypatch, capsys):
    asked = []

    def regress(config):
        asked.append(config)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return 0

    monkeypatch.setattr(run, "regress", regress)
    subject, policy = subject_of(TrainConfig(robot="lite_biped")), tmp_path / "policy.onnx"
    assert measure(subject, policy, tmp_path)
    line = "measuring with the suite velocity: 96 episodes; Ctrl-C leaves it out\n"
    assert capsys.readouterr().err == line
    assert (asked[0].suite, asked[0].robot, asked[0].policies) == ("velocity", "lite_biped", (str(policy),))
    assert not measure(subject, policy, tmp_path)
    assert capsys.readouterr().err == f"{line}regress: left out; {policy} is whole\n"


def test_a_task_without_a_suite_is_not_measured(tmp_path, capsys):
    subject = subject_of(TrainConfig(task="balance"))
    assert measure(subject, tmp_path / "policy.onnx", tmp_path)
    assert capsys.readouterr().err == "regress: no suite ships for the task balance\n"


@pytest.fixture
def usual_handler():
    """Whatever the test runner has inherited."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("usual_handler")
def test_the_first_is_noted_and_the_second_ends(capfd):
    with interruptible() as interruption:
        assert not interruption.is_set()
        signal.raise_signal(signal.SIGINT)
        assert interruption.is_set()
        assert "Ctrl-C: ends after this update, with a checkpoint; once more ends at once\n" in capfd.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("usual_handler")
def test_the_handler_is_as_it_was_afterwards():
    with interruptible() as interruption:
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not interruption.is_set()


@pytest.mark.usefixtures("usual_handler")
def test_a_process_that_ignores_it_goes_on_to():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruptible() as interruption:
        signal.raise_signal(signal.SIGINT)
    assert not interruption.is_set()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


LEGS = subject_of(TrainConfig(robot="lite_biped"))


class Still:
    """Answers zeros, and keeps what it saw."""

    def __init__(self):
        self.seen = []

    def answer(self, observations):
        assert observations.shape == (1, 53)
        self.seen.append(observations[0])
        return np.zeros((1, 14), dtype=np.float32)


@pytest.mark.slow  # draws
def test_a_video_shows_an_episode_at_half_speed_ahead(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "_VIDEO_SECONDS", 0.4)
    now = [0.0]
    monkeypatch.setattr(run.time, "monotonic", lambda: now[0])
    still = Still()
    videos = Videos(LEGS, tmp_path, 1.0)
    for seconds, steps in ((59.0, 1000), (61.0, 2000), (100.0, 3000)):
        now[0] = seconds
        videos.show(still.answer, steps)
    videos.close()
    videos.close()
    assert [path.name for path in (tmp_path / "videos").iterdir()] == ["0000002000.mp4"]
    assert len(still.seen) == 20
    np.testing.assert_allclose(still.seen[-1][6:9], [0.4, 0.0, 0.0])  # the contract's greatest is 0.8 m/s
    with av.open(str(tmp_path / "videos" / "0000002000.mp4")) as opened:
        stream = opened.streams.video[0]
        assert (stream.width, stream.height, stream.frames) == (640, 360, 10)


def test_none_is_made_unless_asked_for(tmp_path):
    answer = None  # which would fail
    for minutes in (None, 60.0):
        videos = Videos(LEGS, tmp_path, minutes)
        videos.show(answer, 1000)
        videos.close()
        assert (tmp_path / "videos").exists() is (minutes is not None)


@pytest.mark.slow
def test_a_network_that_fails_leaves_no_video(tmp_path):
    def answer(observations):
        raise RuntimeError("broken")

    videos = Videos(LEGS, tmp_path, 1e-9)
    with pytest.raises(RuntimeError, match="broken"):
        videos.show(answer, 1000)
    assert list((tmp_path / "videos").iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "videos").write_text("")
    with pytest.raises(InputError, match=r"videos: cannot be made a folder: File exists"):
        Videos(LEGS, tmp_path, 1.0)
