"""What is wrong with a command line is said in one line that names the option and what is accepted."""

import shlex

import pytest
from refusals import is_said

from humanoid_sim.cli import main

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
