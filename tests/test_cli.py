import importlib.util
import shlex
import subprocess
import sys

import pytest
from refusals import is_said

from humanoid_sim import __version__
from humanoid_sim.cli import VERBS, load_program, main, run_program
from humanoid_sim.errors import InputError, MissingPackageError, RobotError


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InputError("x.onnx: is empty"), 2, "error: x.onnx: is empty"),
        (RobotError("can0: joint 3 is silent"), 2, "error: can0: joint 3 is silent"),
        (
            MissingPackageError("viser", "viewer", "--viewer web"),
            2,
            "error: --viewer web needs the package 'viser', which is not installed: pip install 'humanoid_sim[viewer]'",
        ),
        (PermissionError(13, "Permission denied", "robot.xml"), 2, "error: robot.xml: Permission denied"),
        (OSError(24, "Too many open files"), 2, "error: Too many open files"),
        (
            InputError("unknown term 'a\nb\x1b[31m\u2028\udc80', expected M⁻¹·K_d …"),
            2,
            "error: unknown term 'a\\nb\\x1b[31m\\u2028\\udc80', expected M⁻¹·K_d …",
        ),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_ends_a_program_is_one_line_and_a_status(error, status, line, capsys):
    def program(arguments):
        raise error

    assert run_program(program) == status
    assert capsys.readouterr() == ("", f"{line}\n")


def test_the_list_of_verbs(capsys):
    for words in ([], ["-h"], ["--help"]):
        assert main(words) == 0
        out = capsys.readouterr().out
        assert out.startswith("usage: python -m humanoid_sim VERB [options]")
        assert max(len(line) for line in out.splitlines()) <= 80
        text = " ".join(out.split())
        for verb, purpose in VERBS.items():
            assert f"\n  {verb:<16}" in out
            assert f"{verb} {purpose}" in text
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{__version__}\n"


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_is_a_program_with_help_and_one_line_for_bad_input(verb, capsys):
    assert importlib.util.find_spec(f"humanoid_sim.{verb}") is not None  # for `python -m`
    assert callable(load_program(verb))
    with pytest.raises(SystemExit) as caught:
        main([verb, "--help"])
    assert caught.value.code == 0
    assert f"usage: python -m humanoid_sim.{verb}" in capsys.readouterr().out
    if verb != "ros2_services":  # which has the standard library's parser
        assert main([verb, "--no-such-option"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom humanoid_sim.play import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sorted({'mujoco', 'numpy', 'onnxruntime', 'onnx', 'av', 'PIL', 'mcap'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == ""


REFUSED = {
    "plya": "unknown verb 'plya' (did you mean 'play'?); known: play, robot, …",
    "policy chek": "Unrecognized options: chek; Available subcommands: show, check, stamp, doctor; …",
    "mode dmap": "invalid choice 'dmap' for argument 'intent'. Expected one of ('damp', …",
    "play --robt lite": "Unrecognized options: --robt, lite; Perhaps you meant: --robot …",
    "play x.onnx": "Unrecognized options: x.onnx; …",
    "play --duration x": "Error parsing --duration: …",
    "play --script": "Missing value for argument '--script'. Expected 1 values.; …",
    "play --policy lite_pino": "--policy: unknown policy 'lite_pino' (did you mean 'lite_piano'?); known: …",
    "play --policy lite_biped_velocity": "--robot: policy on robot 'lite': …",
    "play --policy lite_tracking --policy lite_tracking": "--policy: lite_tracking, lite_tracking are not different …",
    "play --policy lite_tracking --policy none": "--policy: several are given, expected none of them to be 'none', …",
    "play --robot lite_biped --policy lite_biped_velocity --command 2,0,0": "--command: vx is 2 m/s, expected …",
    "play --robot lite_bipd": "unknown robot 'lite_bipd' (did you mean 'lite_biped'?); known: lite, …",
    "play --robot lite_piano --motion twinkl": "--motion: unknown song 'twinkl' (did you mean 'twinkle'?); known: …",
    "play --hardware virtual:lite --accept-firmware 0.5 --dry-run": "firmware version: is '0.5', expected four…",
    "play --motion wve": "--motion: unknown motion 'wve' (did you mean 'wave'?); known: circle, …",
    "prepare --policy lite_pino --motion x.npz": "--policy: unknown policy 'lite_pino' (did you mean 'lite_piano'?…",
    "policy show lite_pino": "CHECKPOINT: unknown policy 'lite_pino' (did you mean 'lite_piano'?); …",
    "regress lite_tracking --suite velocty": "--suite: unknown suite 'velocty' (did you mean 'velocity'?); known: …",
    "policy check x.onnx": "Missing from python -m humanoid_sim.policy check: --robot …",
    "hardware ping can0": "Missing from python -m humanoid_sim.hardware ping: MOTOR_ID …",
}


@pytest.mark.parametrize("command", REFUSED)
def test_one_line(command, capsys):
    assert main(shlex.split(command)) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert is_said(REFUSED[command], error), error
