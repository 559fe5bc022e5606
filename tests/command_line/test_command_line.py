"""What is wrong with a command line is said in one line."""

import os
import subprocess
import sys

import pytest

from humanoid_sim.cli import main

HELP = "--help' says what is accepted"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("plya",), "unknown verb 'plya' (did you mean 'play'?); known: play, robot, "),
        (
            ("policy", "chek"),
            "policy: unknown command 'chek' (did you mean 'check'?); known: show, check, stamp, doctor",
        ),
        (
            ("policy", "/tmp/x.onnx"),
            "policy: unknown command '/tmp/x.onnx'; known: show, check, stamp, doctor; did you mean 'policy show "
            "/tmp/x.onnx'?",
        ),
        (
            ("record", "run.mcap"),
            "record: unknown command 'run.mcap'; known: info, recover, export; did you mean 'record info run.mcap'?",
        ),
        (
            ("record", "export", "run.mcap", "--png", "x.png"),
            "unknown option '--png'; known: --urdf, --csv, --mp4, --rerun, --robot, --overwrite",
        ),
        (
            ("hardware", "param", "gett"),
            "hardware param: unknown command 'gett' (did you mean 'get'?); known: get, set, ",
        ),
        (("mode", "dmap"), "mode: unknown intent 'dmap' (did you mean 'damp'?); known: damp, load_a, "),
        (("mode", "damp", "--session", "x"), "--session: is 'x', expected a whole number; "),
        (("mode",), f"missing: INTENT; 'python -m humanoid_sim.mode {HELP}"),
        (("play", "--robt", "lite"), "unknown option '--robt' (did you mean '--robot'?); "),
        (("training", "train", "--steps", "1.5"), "--steps: is '1.5', expected a whole number; "),
        (("training", "train", "--steps", "2e6"), "--steps: is '2e6', expected a whole number; "),
        (("play", "--xyz=3"), "unknown option '--xyz'; 'python -m humanoid_sim.play --help' lists all"),
        (("play", "--no-console"), "unknown option '--no-console' (did you mean '--console'?); "),
        (
            ("play", "--viewer", "natve"),
            "--viewer: unknown choice 'natve' (did you mean 'native'?); known: auto, none, native, ",
        ),
        (("play", "--viewer=x"), "--viewer: unknown choice 'x'; known: auto, none, native, rerun"),
        (("play", "--yaw", "x"), f"--yaw: is 'x', expected a number; 'python -m humanoid_sim.play {HELP}"),
        (("play", "--duration", "x"), "--duration: is 'x', expected a number; "),
        (("play", "--host-id", "3.5"), "--host-id: is '3.5', expected a whole number; "),
        (
            ("play", "--policy", "lite_pino"),
            "--policy: unknown policy 'lite_pino' (did you mean 'lite_piano'?); known: lite_biped_velocity, "
            "lite_piano, lite_tracking, placeholder, none; or a file that exists (.onnx)\n",
        ),
        (("play", "--shadow", "lite_pino"), "--shadow: unknown policy 'lite_pino' (did you mean 'lite_piano'?); "),
        (("plants", "--policy", "lite_pino"), "--policy: unknown policy 'lite_pino' (did you mean 'lite_piano'?); "),
        (
            ("prepare", "--policy", "lite_pino", "--motion", "x.npz"),
            "--policy: unknown policy 'lite_pino' (did you mean 'lite_piano'?); ",
        ),
        (("piano", "table", "--policy", "lite_pino"), "--policy: unknown policy 'lite_pino' (did you mean "),
        (("policy", "show", "lite_pino"), "CHECKPOINT: unknown policy 'lite_pino' (did you mean 'lite_piano'?); "),
        (("policy", "doctor", "lite_pino", "--robot", "lite"), "CHECKPOINT: unknown policy 'lite_pino' (did you "),
        (("regress", "lite_traking"), "POLICIES: unknown policy 'lite_traking' (did you mean 'lite_tracking'?); "),
        (
            ("regress", "lite_tracking", "--baseline", "lite_traking"),
            "--baseline: unknown policy 'lite_traking' (did you mean 'lite_tracking'?); ",
        ),
        (
            ("play", "--policy", "lite_biped_velocity"),
            "it fits --robot lite_biped; policy on robot 'lite': ",
        ),
        (("play", "--script"), "--script: its value is missing; "),
        (
            ("hardware", "set-id", "can0", "127", "14"),
            f"unexpected: 14; 'python -m humanoid_sim.hardware set-id {HELP}",
        ),
        (("play", "x.onnx"), f"unexpected: x.onnx; 'python -m humanoid_sim.play {HELP}"),
        (("play", "--robot", "lite_bipd"), "unknown robot 'lite_bipd' (did you mean 'lite_biped'?); known: lite, "),
        (("play", "--motion", "wve"), "--motion: unknown motion 'wve' (did you mean 'wave'?); known: circle, "),
        (("play", "--policy", "placeholder", "--script", "dmap"), "--script: "),
        (
            ("regress", "lite_tracking", "--suite", "velocty"),
            "--suite: unknown suite 'velocty' (did you mean 'velocity'?); known: ",
        ),
        (("policy", "check", "x.onnx"), f"missing: --robot ROBOT; 'python -m humanoid_sim.policy check {HELP}"),
        (("policy", "check"), "missing: CHECKPOINT, --robot ROBOT; "),
        (("hardware", "ping", "can0", "x"), "MOTOR_ID: is 'x', expected a whole number; "),
        (("hardware", "ping", "can0"), "missing: MOTOR_ID; "),
    ],
)
def test_one_line(words, line, capsys):
    assert main(words) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith(f"error: {line}")
    assert error.count("\n") == 1


def test_underscores_do_as_well(capsys):
    assert main(["play", "--policy_seconds", "x"]) == 2
    assert capsys.readouterr().err.startswith("error: --policy-seconds: is 'x', expected a number; ")


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_whatever_the_terminal_can_show(encoding):
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.play", "--yaw", "x" * 300],
        env={**os.environ, "PYTHONIOENCODING": encoding, "COLUMNS": "40"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"error: --yaw: is '{'x' * 300}', expected a number; 'python -m humanoid_sim.play {HELP}\n"


@pytest.mark.parametrize("words", [("training",), ("policy",)])
def test_a_group_of_commands_alone_lists_them(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    alone = capsys.readouterr().out
    assert alone.startswith(f"usage: python -m humanoid_sim.{' '.join(words)} COMMAND ...\n")
    with pytest.raises(SystemExit):
        main([*words, "--help"])
    assert capsys.readouterr().out == alone
