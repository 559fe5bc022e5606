"""Options that are wrong, or wrong together: exit status 2, one line, and nothing left behind."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import models
import numpy as np
import pytest

from humanoid_sim.assets import motion_path
from humanoid_sim.errors import InputError
from humanoid_sim.play.conflicts import choose_outputs, refuse_conflicts, refuse_early
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.motion import Motion, write_motion
from humanoid_sim.session.inject import parse_injections

MANUAL = "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"
FAULTS = "expected FAULT@SECONDS with FAULT one of nan_policy, safety, silent_remote"

LONG = "x" * 300

BAD = [
    ("--policy no.onnx", "no.onnx: no such file, expected an ONNX file"),
    ("--policy no.pt", "no.pt: no such file, expected an ONNX file: export it to ONNX first"),
    ("--command 0.5", "--command: is '0.5', expected vx,vy,wz: three numbers in m/s, m/s and rad/s"),
    ("--contract no.yaml", "no.yaml: no such file, expected a YAML file"),
    (
        "--policy-seconds 1 --duration 1",
        "--policy-seconds and --duration: give either --policy-seconds or --duration, not both",
    ),
    ("--policy sub", "sub: is a directory, expected an ONNX file"),
    ("--policy empty", "empty: is empty, expected an ONNX file"),
    ("--policy text.onnx", "text.onnx: is not a model that ONNX Runtime can load: "),
    (
        "--policy other.onnx",
        "--robot: 'lite', the default, is not this policy's robot, name its MJCF or YAML file: "
        "policy on robot 'lite': joint_names of the policy do not match the robot's joints: ",
    ),
    ("--yaw 90", "--yaw: is 90 rad, expected -6.283 to 6.283 rad; is it in degrees? 90° is 1.571 rad"),
    ("--yaw 1", "--yaw: means nothing for 'lite', whose base does not move freely"),
    ("--base-height 1", "--base-height: means nothing for 'lite', whose base does not move freely"),
    ("--drop 0", "--drop: means nothing for 'lite', whose base does not move freely"),
    ("--robot lite_biped --drop 0.1 --base-height 1", "--drop: means nothing for a base whose height is given"),
    ("--robot lite_biped --drop -0.1", "--drop: is -0.1 m, expected 0 to 1 m"),
    ("--command 1,0,0", "--command: means nothing for this policy, which observes no velocity command"),
    ("--policy narrow.onnx", "narrow.onnx: its terms are 8 wide (joint_pos 3 + joint_vel 3 + actions 2), its "),
    ("--policy strange.onnx", "strange.onnx: unknown observation term 'mood'; known: actions, "),
    ("--policy follows.onnx", "--motion: is missing; follows.onnx is a tracking policy and follows a motion"),
    ("--policy follows.onnx --motion wave", "{wave}: describes the bodies left_elbow_pitch, "),
    ("--policy follows.onnx --motion slow.mcap", "slow.mcap: has a frame every 0.04 s, follows.onnx a "),
    ("--policy follows.onnx --motion keys.mcap", "keys.mcap: is a motion for task_type piano; "),
    ("--policy other.onnx --motion wave", "--motion: is 'wave', but other.onnx follows no motion"),
    ("--policy placeholder --motion wave", "--motion: is 'wave', but placeholder follows no motion"),
    ("--motion jump", "--motion: unknown motion 'jump'; known: circle, "),
    ("--motion text.onnx", "text.onnx: not an MCAP file"),
    ("--motion empty", "empty: the file is empty"),
    ("--motion sub", "sub: is a directory, expected a motion file (.mcap)"),
    ("--robot atlas", "unknown robot 'atlas'; known: lite, lite_biped, lite_neck, lite_piano"),
    (
        "--robot sub",
        "sub: is a folder, expected a robot's YAML file, an MJCF or one of: lite, lite_biped, lite_neck, "
        "lite_piano, lite_piano_nikomaku, lite_sito",
    ),
    ("--robot empty", "empty: is empty, expected a robot description"),
    ("--robot lite_neck", "policy on robot 'lite_neck': joint_names of the policy do not match the robot's joints: "),
    ("--hardware can0", "--calibration: is missing, and there is no calibration.yaml here; without it nobody knows "),
    ("--hardware can0 --calibration no.yaml", "no.yaml: no such file, expected a calibration (YAML)"),
    ("--hardware ''", "bus '': names no channel; expected a network interface such as can0, or interface:channel "),
    ("--hardware virtual:a,can0", "--hardware: is 'virtual:a,can0', expected virtual channels only, or none"),
    ("--hardware virtual:a,virtual:b,virtual:c", "lite: "),
    ("--hardware virtual:a --script damp", "--script: would move a real robot with nobody at the keys; add "),
    ("--hardware virtual:a --pace fast", "--pace: is fast, but the time of a real robot is real"),
    ("--hardware virtual:a --command-delay 0.001", "--command-delay: means nothing with --hardware"),
    ("--hardware virtual:a --yaw 1", "--yaw: means nothing with --hardware"),
    ("--dry-run", "--dry-run: means nothing without --hardware"),
    ("--calibration c.yaml", "--calibration: means nothing without --hardware"),
    ("--imu microstrain:/dev/ttyACM0", "--imu: means nothing without --hardware"),
    ("--gamepad --no-gamepad", "--gamepad and --no-gamepad: expected at most one of them"),
    ("--no-gamepad", "--no-gamepad: means nothing without --hardware"),
    ("--viewer native", "--viewer native: there is no display here; use --video out.mp4 instead"),
    ("--manual", MANUAL),
    ("--manual --script damp", "--manual and --script: both drive the FSM, expected at most one of them"),
    ("--script ''", "--script: is empty, expected steps separated by ';', each one of damp, "),
    ("--script 'damp; run'", "--script: step 2 is 'run', expected one of damp, load_a, load_b, start_locomotion, "),
    ("--script 'damp; hold x'", "--script: step 2 is 'hold x', expected hold with a number of seconds >= 0"),
    ("--inject fire@1", f"--inject: is 'fire@1', {FAULTS}"),
    ("--inject safety", f"--inject: is 'safety', {FAULTS}"),
    ("--inject safety@1 safety@-1", f"--inject: is 'safety@-1', {FAULTS}"),
    ("--inject silent_remote@1", "--inject: silent_remote needs a source of commands to silence: use --remote "),
    ("--policy none --motion wave", "--motion: means nothing without a policy"),
    ("--policy none --command 1,0,0", "--command: means nothing without a policy"),
    (
        "--hardware virtual:x --motion wave",
        "--motion: means nothing without --policy: on hardware none runs by default",
    ),
    ("--policy none --branch x.mcap@1", "--policy: is none, but --branch goes on with a policy"),
    ("--branch run.mcap@2.9 --yaw 1", "--yaw: means nothing with --branch"),
    ("--branch run.mcap@2.9 --again run.mcap", "--again: means nothing with --branch"),
    ("--branch run.mcap@2.9 --hardware virtual:lite", "--hardware: means nothing with --branch"),
    *[
        (f"--branch {text}", f"--branch: is '{text}', expected FILE@SECONDS")
        for text in ("run.mcap", "@3", "run.mcap@", "run.mcap@soon", "run.mcap@nan")
    ],
    ("--policy-seconds 5 --script damp", "--policy-seconds: means nothing with --script"),
    ("--policy-seconds 5 --remote gravity", "--policy-seconds: means nothing with --remote"),
    (
        "--policy-seconds 5 --hardware virtual:lite --policy placeholder",
        "--policy-seconds: means nothing with --hardware",
    ),
    ("--allow-sign-contradiction left_elbow", "--allow-sign-contradiction: unknown joint 'left_elbow'"),
    ("--duration 0", "--duration: is 0.0, expected a finite number > 0"),
    ("--duration -1", "--duration: is -1.0, expected a finite number > 0"),
    ("--duration nan", "--duration: is nan, expected a finite number > 0"),
    ("--duration inf", "--duration: is inf, expected a finite number > 0"),
    ("--control-frequency 0", "--control-frequency: is 0.0, expected a finite number > 0"),
    ("--control-frequency nan", "--control-frequency: is nan, expected a finite number > 0"),
    (
        "--control-frequency 330",
        "--physics-timestep: 0.0005 s does not divide the control period of 0.00285714 s; the nearest that does is "
        "0.00047619 s (6 per period); the control rate moves from 330 Hz to 350 Hz, 7 times the policy's 50 Hz",
    ),
    (
        "--physics-timestep 0.0007",
        "--physics-timestep: 0.0007 s does not divide the control period of 0.005 s; the nearest that does is "
        "0.000714286 s (7 per period)",
    ),
    ("--physics-timestep 0", "--physics-timestep: is 0.0 s, expected a finite number > 0"),
    ("--physics-timestep -1", "--physics-timestep: is -1.0 s, expected a finite number > 0"),
    ("--physics-timestep 1e-9", "--physics-timestep: is 1e-09 s, expected at least 5e-07 s, which makes 10000 "),
    ("--physics-timestep 5e-324", "--physics-timestep: is 4.94066e-324 s, expected at least 5e-07 s, which "),
    ("--control-frequency 1e300", "--control-frequency: is 1e+300 Hz, expected at most 500000 Hz, which makes "),
    ("--physics-timestep nan", "--physics-timestep: is nan s, expected a finite number > 0"),
    ("--physics-timestep 0.005", "lite: joints, standby_controller_a, standby_controller_b: dt·M⁻¹·K_d reaches "),
    ("--command-delay -0.001", "--command-delay: is -0.001 s, expected 0 to 10 s"),
    ("--command-delay nan", "--command-delay: is nan s, expected 0 to 10 s"),
    ("--command-delay 0.0007", "--command-delay: 0.0007 s is not a multiple of the physics step of 0.0005 s; the "),
    ("--state-delay inf", "--state-delay: is inf s, expected 0 to 10 s"),
    ("--record ''", "--record: is empty, expected a file name"),
    (f"--policy {LONG}", f"--policy: unknown policy '{LONG}'; known: lite_biped_velocity, "),
    ("--policy pipe", "pipe: is a pipe or a device, expected an ONNX file"),
    (f"--contract {LONG}", f"{LONG}: cannot be read: File name too long"),
    ("--contract pipe", "pipe: is a pipe or a device, expected a YAML file"),
    (f"--robot {LONG}", f"unknown robot '{LONG}'; known: "),
    (f"--motion {LONG}", f"--motion: unknown motion '{LONG}'; known: "),
    ("--motion pipe", "pipe: is a pipe or a device, expected a motion file (.mcap)"),
    (f"--record {LONG}.mcap", f"--record: '{LONG}.mcap' cannot be written: File name too long"),
    ("--record pipe.mcap --overwrite", "--record: 'pipe.mcap' is a pipe or a device, expected a file name"),
    (f"--summary {LONG}.json", f"--summary: '{LONG}.json' cannot be written: File name too long"),
    ("--record r.bag", "--record: is 'r.bag', expected a name that ends in .mcap"),
    ("--record sub.mcap", "--record: 'sub.mcap' is a directory, expected a file name"),
    ("--record no/r.mcap", "--record: the folder 'no' does not exist"),
    ("--record empty/r.mcap", "--record: the folder 'empty' does not exist"),
    ("--record there.mcap", "--record: 'there.mcap' exists; choose another name, or add --overwrite"),
    ("--video v.avi", "--video: is 'v.avi', expected a name that ends in .mp4"),
    ("--video no/v.mp4", "--video: the folder 'no' does not exist"),
    ("--snapshot p.gif", "--snapshot: is 'p.gif', expected a name that ends in .png"),
    ("--snapshot no/p.png", "--snapshot: the folder 'no' does not exist"),
    ("--summary s.txt", "--summary: is 's.txt', expected a name that ends in .json"),
    ("--summary no/s.json", "--summary: the folder 'no' does not exist"),
]


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


@pytest.mark.parametrize(("options", "expected"), BAD)
def test_a_bad_option_is_one_line_and_leaves_nothing(options, expected, inputs, run):
    before = sorted(inputs.rglob("*"))
    result = run(*shlex.split(options), record=False)
    assert result.status == 2
    assert result.out == ""
    expected = expected.replace("{wave}", str(motion_path("wave")))
    assert result.err.startswith(f"error: {expected}")
    assert result.err.endswith("\n")
    assert result.err.count("\n") == 1
    assert sorted(inputs.rglob("*")) == before


UNPARSED = [
    "--bogus", "extra", "--duration soon", "--pose c", "--viewer window", "--actuation springs", "--pace slow",
    "--state-sampling later", "--gravity-form full", "--remote ros", "--robot",
]  # fmt: skip


@pytest.mark.parametrize("options", UNPARSED)
def test_what_the_parser_refuses_names_the_option_and_leaves_nothing(options, folder, run):
    result = run(*options.split(), record=False)
    assert result.status == 2
    assert result.out == ""
    assert options.split(maxsplit=1)[0] in result.err
    assert list(folder.iterdir()) == []


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
