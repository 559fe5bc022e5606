"""The IMU wherever it is, on a robot whose inertia is turned: `play` and every environment measure the same."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from models import linear_model, saved
from recorded_start import recorded_start

from humanoid_sim.controllers.rotation import rotate_inverse
from humanoid_sim.envs import dm
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.messages import Mode
from humanoid_sim.play import main
from humanoid_sim.policy.layers import Layer, join
from humanoid_sim.policy.readers.own import flattened
from humanoid_sim.recording.reader import open_recording

STOOL = """
<mujoco model="stool">
  <compiler angle="degree"/>
  <option timestep="0.001"/>
  <default><geom friction="1" condim="3"/></default>
  <worldbody>
    <body name="trunk" pos="0 0 0.4">
      <freejoint/>
      <inertial pos="0.02 -0.03 0.05" euler="30 40 50" mass="6" diaginertia="0.05 0.11 0.14"/>
      <geom type="box" size="0.15 0.1 0.05"/>
      <site name="base_site" pos="0.1 0.05 -0.02" euler="10 -20 70"/>
      <body name="head" pos="0.05 0 0.1">
        <joint name="neck" axis="0 1 0.2" range="-60 60" damping="0.3" armature="0.01"/>
        <inertial pos="0 0.01 0.08" euler="-20 70 10" mass="0.8" diaginertia="0.002 0.004 0.005"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.15" size="0.03"/>
        <site name="head_site" pos="0.03 0.01 0.12" euler="40 10 -30"/>
      </body>
      <body name="left" pos="0 0.12 -0.05">
        <joint name="left_hip" axis="0 1 0" range="-60 60" damping="0.2" armature="0.01"/>
        <geom type="box" pos="0 0.03 -0.15" size="0.15 0.03 0.15" mass="1"/>
      </body>
      <body name="right" pos="0 -0.12 -0.05">
        <joint name="right_hip" axis="0 1 0" range="-60 60" armature="0.01"/>
        <geom type="box" pos="0 -0.03 -0.15" size="0.15 0.03 0.15" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = ["neck", "left_hip", "right_hip"]
FRAMES = ("trunk", "base_site", "head", "head_site")
WIRING = {
    "joint_names": JOINTS,
    "joint_stiffness": [10.0, 40.0, 40.0],
    "joint_damping": [0.5, 2.0, 2.0],
    "default_joint_pos": [0.1, 0.05, -0.05],
    "observation": [
        "base_ang_vel",
        "imu_linear_acceleration",
        "imu_quaternion",
        "projected_gravity",
        "joint_pos",
        "base_lin_vel",
        {"name": "of_the_imu", "kind": "base_lin_vel", "at": "imu"},
        {"name": "of_the_head", "kind": "base_lin_vel", "at": "head_site", "frame": "world"},
    ],
    "action_scale": 0.5,
    "policy_dt": 0.02,
    "command_ranges": {"lin_vel_x": [-1, 1], "lin_vel_y": [-1, 1], "ang_vel_z": [-1, 1]},
}
WIDTH = 25
POINTS = ("base_linear_velocity", "base_linear_velocity_at_imu", "base_linear_velocity_at_head_site")


@pytest.fixture
def folder(tmp_path, monkeypatch, runtime):
    """The working folder, with the stool; the sockets of `play` go there too."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "stool.xml").write_text(STOOL, encoding="utf-8")
    return tmp_path


def robot_with(frame):
    """The stool with its IMU there; its path."""
    hips = {"lower": -1.0, "upper": 1.0, "effort_limit": 50.0, "stiffness": 40.0, "damping": 2.0}
    standby = {
        "target_stiffness": [40.0] * 3,
        "target_damping": [2.0] * 3,
        "segment_durations": [0.2],
        "pose_segments": [[0.1, 0.05, -0.05]],
    }
    document = {
        "name": "stool",
        "mjcf": "stool.xml",
        "joints": [{"name": name, **hips} for name in JOINTS],
        "initial_position": [0.1, 0.05, -0.05],
        "imu": frame,
        "base": {"type": "floating", "body": "trunk"},
        "simulation": {"physics_timestep": 0.001, "control_frequency": 100},
        "standby_controller_a": standby,
        "standby_controller_b": standby,
    }
    Path("stool.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return "stool.yaml"


def contract(**fields):
    return join([Layer("test", dict(flattened({**WIRING, **fields}, "test")))], "test").contract


def actions(steps):
    return np.random.default_rng(1).normal(0.0, 0.6, (steps, 3)).astype(np.float32)


def network(**fields):
    weights = np.random.default_rng(0).normal(0.0, 0.05, (WIDTH, 3)).astype(np.float32)
    saved(Path("policy.onnx"), linear_model({}, matrix=weights))
    Path("contract.yaml").write_text(yaml.safe_dump({**WIRING, **fields}), encoding="utf-8")
    return "policy.onnx"


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("actuation", ["affine", "qfrc_applied"])
def test_environments_agree(folder, frame, actuation):
    robot = robot_with(frame)
    wired = contract()
    options = {"joint_noise": 0.1, "velocity_noise": 0.5}
    single = PolicyEnv(wired, robot, task="balance", actuation=actuation, **options)
    theirs = dm.load("policy", contract=wired, robot=robot, task="balance", seed=3, actuation=actuation, **options)
    vector = PolicyVectorEnv(2, wired, robot, task="balance", threads=1, **options)
    observation, _ = single.reset(seed=3)
    several, _ = vector.reset(seed=[7, 3])
    np.testing.assert_allclose(several[1], observation, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.concatenate(list(theirs.reset().observation.values())), observation)
    turned = away = 0.0
    for action in actions(12):
        observation, _, terminated, _, info = single.step(action)
        assert not terminated, info
        several, *_ = vector.step(np.stack([action, action]))
        one = single.robot.truth()
        batch = vector.simulation.truth()
        turned = np.maximum(turned, np.abs(one.imu_angular_velocity))
        for name in ("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration"):
            np.testing.assert_allclose(getattr(batch, name)[1], getattr(one, name), rtol=0, atol=1e-9, err_msg=name)
        for name in POINTS:
            np.testing.assert_allclose(batch.extern[name].value[1], one.extern[name].value, rtol=0, atol=1e-9)
        base, imu, head = (one.extern[name].value for name in POINTS)
        away = max(away, np.abs(head - base).max())
        turn = rotate_inverse(one.imu_quaternion, np.stack([base, imu]))
        np.testing.assert_array_equal(observation[16:], np.float32([*turn[0], *turn[1], *head]))
        assert (frame == "trunk") == np.allclose(base, imu, atol=1e-12)
        assert (frame == "head_site") == np.allclose(head, imu, atol=1e-12)
        step = theirs.step(action)
        np.testing.assert_array_equal(np.concatenate(list(step.observation.values())), observation)
    assert np.all(turned > 0.05)  # about all three axes
    assert away > 0.05


@pytest.mark.parametrize("frame", FRAMES)
def test_play_is_the_single_environment(folder, frame):
    robot = robot_with(frame)
    path = network()
    script = ("--script", "damp; load_a; wait; start_locomotion; hold 0.4; damp", "--record", "r.mcap")
    main(["--viewer", "none", "--robot", robot, "--policy", path, *script])
    ticks = [
        tick
        for tick in open_recording(folder / "r.mcap").ticks()
        if tick.output.control_mode.mode is Mode.LOCOMOTION and tick.output.policy_step
    ]
    assert len(ticks) >= 20
    env = PolicyEnv(path, robot, task="balance", actuation="qfrc_applied")
    observation, _ = env.reset(options=recorded_start("r.mcap", env.scenario.description))
    for tick in ticks:
        state, step = env.robot.read()[0], tick.output.policy_step
        for name in ("imu_quaternion", "imu_angular_velocity", "imu_linear_acceleration"):
            assert getattr(state, name).tobytes() == getattr(tick.input.state, name).tobytes(), name
        for name in POINTS:
            assert state.extern[name].value.tobytes() == tick.input.state.extern[name].value.tobytes(), name
        assert observation.tobytes() == step.observation.tobytes()
        observation, *_ = env.step(step.action)


@pytest.mark.parametrize(
    ("decision", "own", "says"),
    [
        ({}, [0.3, 0.2, 0.0], "nobody decides, so both act"),
        ({"model_joint_damping": "keep"}, [0.3, 0.2, 0.0], "keep: both act"),
        ({"model_joint_damping": "drop"}, [0.0, 0.0, 0.0], "drop: simulations leave out the second number"),
    ],
)
def test_damping_of_the_model_is_what_the_contract_says(folder, decision, own, says, capsys):
    robot = robot_with("trunk")
    path = network(**decision)
    single, vector = PolicyEnv(path, robot), PolicyVectorEnv(2, path, robot, threads=1)
    for model in (single.robot.model, vector.simulation.model(1)):
        assert [model.dof_damping[model.joint(name).dofadr[0]] for name in JOINTS] == own
    main(["--viewer", "none", "--record", "r.mcap", "--robot", robot, "--policy", path, "--script", "damp"])
    out = capsys.readouterr().out
    (note,) = (line for line in out.splitlines() if line.startswith("note: model_joint_damping: "))
    assert says in note
    assert "N·m·s/rad: 0.5 + 0.3 for neck; 2 + 0.2 for left_hip" in note
    recorded = open_recording(folder / "r.mcap").header.documents["robot"]
    assert f'"joint_damping":"{decision.get("model_joint_damping", "keep")}"' in recorded
