"""The programs around the motors: `hardware identify`, and what `play --hardware` refuses or bounds."""

import json

import numpy as np
import onnx
import pytest
import yaml
from motor_surface import identify, policy_of_play, run_play
from onnx import helper, parser
from wire_motor import CAN_TIMEOUT, ENABLE, RESET, WRITE
from wire_rig import Pair, robot_document

MJCF = """
<mujoco><worldbody><body name="base"><site name="imu"/>
  <body pos="0 0.2 1"><joint name="left" axis="0 0 1" armature="0.01"/><geom size="0.05" mass="0.2"/></body>
  <body pos="0 -0.2 1"><joint name="right" axis="0 0 1" armature="0.01"/><geom size="0.05" mass="0.2"/></body>
</body></worldbody></mujoco>
"""
ENDLESS = """
<ir_version: 9, opset_import: ["" : 17]>
policy (float[1,2] observation) => (float[1,2] action)
<float many = {9e18}, bool go = {1}>
{
  largest = ReduceMax <keepdims = 0> (observation)
  product = Mul (largest, many)
  count = Cast <to = 7> (product)
  zeros = Sub (observation, observation)
  action = Loop <body = again (int64 i, bool c, float[1,2] x) => (bool d, float[1,2] y)
    { d = Identity (c) y = Identity (x) }> (count, go, zeros)
}
"""
"""A policy that is never done where an observation is positive."""
METADATA = {
    "task_type": "locomotion",
    "joint_names": "left,right",
    "action_joint_names": "left,right",
    "joint_stiffness": "50,50",
    "joint_damping": "2,2",
    "default_joint_pos": "-1,-0.4",
    "observation_names": "joint_pos",
    "command_names": "",
    "action_scale": "0.1",
    "policy_dt": "0.02",
}


@pytest.fixture
def folder(tmp_path, runtime, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair.xml").write_text(MJCF)
    (tmp_path / "pair.yaml").write_text(yaml.safe_dump(robot_document()))
    model = parser.parse_model(ENDLESS)
    helper.set_model_props(model, METADATA)
    onnx.save(model, tmp_path / "endless.onnx")
    return tmp_path


@pytest.fixture
def pair(folder, monkeypatch):
    with Pair(folder, monkeypatch, one_channel=True) as pair:
        for motor in pair.motors:
            motor.follows = True
        yield pair


@pytest.mark.parametrize(("joint", "direction"), [("left", -1), ("right", 1)])
def test_identify_moves_one_joint_the_positive_way_and_back(joint, direction, pair, capsys):
    """So a person sees whether the direction in the robot file is right."""
    motor, other = (pair.left, pair.right) if joint == "left" else (pair.right, pair.left)
    start = motor.position
    assert identify(pair.channels[0], joint, "pair.yaml", 0.2) == 0
    printed = capsys.readouterr().out
    assert joint in printed
    assert f"direction {direction:+d}" in printed
    moved = [command.position - start for command in pair.commands(motor) if command.kp]
    assert direction * max(moved, key=abs) == pytest.approx(0.2, abs=5e-3)
    assert motor.position == pytest.approx(start, abs=0.02)
    assert max(c.kp for c in pair.commands(motor)) * 0.2 < 1.6, "1.5 N·m at most"
    assert motor.mode == RESET
    kinds = [f.kind for f in pair.sent(motor, ENABLE, WRITE) if f.kind == ENABLE or f.index == CAN_TIMEOUT]
    assert kinds[:2] == [WRITE, ENABLE]
    assert not pair.sent(other, ENABLE)


def test_identify_names_a_joint_that_moves_as_well(pair, capsys):
    def belt(frame):
        if frame.operation is not None and frame.operation.kp:
            pair.right.position += 0.01

    pair.left.on_frame = belt
    assert identify(pair.channels[0], "left", "pair.yaml", 0.2) == 1
    assert "right" in capsys.readouterr().err


def test_identify_confirms_no_direction_where_nothing_moved(pair, capsys):
    pair.left.follows = False
    assert identify(pair.channels[0], "left", "pair.yaml", 0.2) == 1
    assert "left" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--robot", "lite_sito", "--hardware", "virtual:survive-play"), "--allow-no-timeout"),
        (("--robot", "lite", "--hardware", "virtual:survive-play", "--can-timeout", "0.02"), "timeout"),
        (("--robot", "lite", "--hardware", "virtual:survive-play", "--can-timeout", "6"), "timeout"),
        (("--robot", "lite", "--hardware", "can7", "--no-gamepad", "--yes"), "--calibration"),
    ],
    ids=["no timeout of their own", "shorter than a period", "longer than a motor takes", "not calibrated"],
)
def test_play_refuses_motors_that_nothing_would_stop_or_nobody_calibrated(words, part, folder, capsys):
    assert run_play(*words, "--policy", "placeholder") == 2
    assert part in capsys.readouterr().err


def test_an_inference_ends_within_half_of_the_can_timeout(folder):
    """It fails in its tick, whose damping reaches the motors before they stop by themselves."""
    policy = policy_of_play(folder / "endless.onnx", "pair.yaml", 0.06)
    assert np.asarray(policy(np.zeros(2, dtype=np.float32), 0)).tolist() == [0.0, 0.0]
    with pytest.raises(TimeoutError, match=r"0\.03 s"):
        policy(np.ones(2, dtype=np.float32), 0)


@pytest.mark.soak
def test_an_endless_inference_ends_in_damping_with_motors_that_still_listen(folder):
    script = "damp; load_a; wait; start_locomotion; hold 0.5"
    words = ("--robot", "pair.yaml", "--policy", "endless.onnx", "--hardware", "virtual:survive-endless")
    options = ("--allow-script", "--script", script, "--can-timeout", "0.4", "--duration", "4", "--summary", "s.json")
    run_play(*words, *options)
    summary = json.loads((folder / "s.json").read_text())
    modes = [span["mode"] for span in summary["modes"]]
    assert modes[-2:] == ["STANDBY", "DAMPING"]
    assert summary["safety"] == []
