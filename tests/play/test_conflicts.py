"""Options that are wrong, or wrong together: exit status 2, one line, and nothing left behind."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import models
import numpy as np
import pytest
from refusals import is_said, refusals

from humanoid_sim.assets import motion_path
from humanoid_sim.errors import InputError
from humanoid_sim.play.conflicts import choose_outputs, refuse_conflicts, refuse_early
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.motion import Motion, write_motion
from humanoid_sim.session.inject import parse_injections

MANUAL = "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"


@pytest.fixture
def inputs(folder):
    """The folder, with files that are there but wrong."""
    (folder / "sub").mkdir()
    (folder / "sub.mcap").mkdir()
    (folder / "empty").touch()
    os.mkfifo(folder / "pipe")
    os.mkfifo(folder / "pipe.mcap")
    (folder / "text.onnx").write_text("a policy", encoding="utf-8")
    (folder / "there.mcap").write_text("mine", encoding="utf-8")
    write = models.write_metadata
    follows = models.contract(
        task_type="tracking", body_names=("hand",), observation=("motion_body_pos_b", "joint_pos", "actions")
    )
    strange = models.contract(observation=("joint_pos", "mood"))
    models.saved(folder / "other.onnx")
    models.saved(folder / "narrow.onnx", models.linear_model(inputs=7))
    models.saved(folder / "strange.onnx", models.linear_model(write(strange)))
    models.saved(folder / "follows.onnx", models.linear_model(write(follows)))
    write_motion(folder / "slow.mcap", Motion(np.ones((3, 9)), ("hand",), 0.04))
    write_motion(folder / "keys.mcap", Motion(np.ones((3, 9)), (), 0.02, "piano"))
    return folder


@pytest.mark.parametrize(("command", "line"), refusals(__file__))
def test_a_bad_option_is_one_line_and_leaves_nothing(command, line, inputs, run):
    before = sorted(inputs.rglob("*"))
    result = run(*shlex.split(command)[1:], record=False)
    assert result.status == 2
    assert result.out == ""
    assert is_said(line.replace("{wave}", str(motion_path("wave"))), result.err), result.err
    assert sorted(inputs.rglob("*")) == before


def test_automatic_outputs(folder, monkeypatch):
    outputs = choose_outputs(PlayConfig())
    assert outputs.record.parent == outputs.video.parent == Path("runs")
    assert (folder / "runs").is_dir()
    assert (outputs.snapshot, outputs.summary) == (None, None)
    assert choose_outputs(PlayConfig(viewer="none")).video is None  # nobody asked to see anything
    monkeypatch.setenv("DISPLAY", ":0")
    assert choose_outputs(PlayConfig()).video is None  # there is a window instead
    none = choose_outputs(PlayConfig(record="none", video="none"))
    assert (none.record, none.video) == (None, None)


def test_a_runs_folder_that_cannot_be_made(folder):
    (folder / "runs").touch()
    with pytest.raises(InputError, match="folder 'runs' for recordings cannot be made: File exists; use --record"):
        choose_outputs(PlayConfig())


def test_a_motion_is_not_overwritten_by_its_own_recording(folder, run):
    before = motion_path("wave").read_bytes()
    (folder / "mine.mcap").write_bytes(before)
    (folder / "other.mcap").symlink_to("mine.mcap")
    for name in ("mine.mcap", "other.mcap", "../work/mine.mcap"):
        result = run("--motion", "mine.mcap", "--record", name, "--overwrite", record=False)
        assert (result.status, result.out) == (2, "")
        assert result.err == f"error: --record: '{name}' is what this run reads; choose another name\n"
    assert (folder / "mine.mcap").read_bytes() == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to(folder):
    (folder / "locked").mkdir(mode=0o500)
    with pytest.raises(InputError, match=r"--summary: 'locked/s.json' cannot be written: Permission denied"):
        choose_outputs(PlayConfig(record="none", video="none", summary="locked/s.json"))


def test_a_missing_terminal_is_noticed_before_anything_is_opened(monkeypatch):
    monkeypatch.setattr("sys.stdin", None)
    with pytest.raises(InputError, match=MANUAL):
        refuse_conflicts(PlayConfig(manual=True), ())
    for operated in ({"console": True}, {"gamepad": ()}, {"hardware": "can0"}):  # a real bus has a gamepad
        refuse_conflicts(PlayConfig(manual=True, viewer="none", **operated), ())
    with pytest.raises(InputError, match=MANUAL):
        refuse_conflicts(PlayConfig(manual=True, hardware="can0", no_gamepad=True), ())


def test_what_remote_makes_possible_is_not_refused():
    injections = parse_injections(["silent_remote@1"])
    refuse_conflicts(PlayConfig(remote="gravity", viewer="none"), injections)
    with pytest.raises(InputError, match="--inject"):
        refuse_conflicts(PlayConfig(viewer="none"), injections)


EARLY = """
import sys
from humanoid_sim.errors import InputError
from humanoid_sim.play import main
try:
    main(sys.argv[1:])
except InputError as error:
    print(error)
print(*(name for name in ("mujoco", "onnxruntime", "onnx") if name in sys.modules), sep=",")
"""


def test_a_file_of_a_trainer_is_refused_before_mujoco_is_imported(tmp_path):
    policy = tmp_path / "my.pt"
    run = subprocess.run(
        [sys.executable, "-c", EARLY, "--policy", str(policy)], capture_output=True, text=True, check=True
    )
    assert run.stdout == f"{policy}: no such file, expected an ONNX file: export it to ONNX first\n\n"


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("my.pt", "is a PyTorch checkpoint, expected an ONNX file: export it to ONNX first"),
        ("my.PTH", "is a PyTorch checkpoint, expected an ONNX file: export it to ONNX first"),
        ("best.zip", "is a stable-baselines3 checkpoint, expected an ONNX file: give the policy.onnx beside it"),
    ],
)
def test_what_to_do_with_a_trainers_own_file(name, line, tmp_path):
    path = tmp_path / name
    path.write_bytes(b"PK")
    with pytest.raises(InputError) as caught:
        refuse_early(PlayConfig(policy=str(path)))
    assert str(caught.value) == f"{path}: {line}"


def test_what_is_right_passes():
    refuse_early(PlayConfig())
    refuse_early(PlayConfig(policy="placeholder", command="0.5,0,-1"))
