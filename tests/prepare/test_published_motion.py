"""The motion inside a published tracking policy of the G1, as its trainer would have saved it."""

import json

import numpy as np
import pytest
from published import G1 as ROBOT
from published import POLICIES, TRACES, needs_policies

from humanoid_sim.cli import run_program
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare import main
from humanoid_sim.robots.description import load_robot

pytestmark = [needs_policies, pytest.mark.usefixtures("near_ends")]

POLICY = POLICIES / TRACES["waltz"][0]


@pytest.fixture(scope="module")
def waltz():
    motion = load_checkpoint(POLICY).motion
    assert motion is not None
    return motion


def parts(motion):
    frames, joints, bodies = motion.frames, len(motion.joint_names), len(motion.body_names)
    position, velocity, place, turn = np.split(frames, np.cumsum([joints, joints, 3 * bodies]), axis=1)
    return {
        "fps": np.array([50]),
        "joint_pos": position,
        "joint_vel": velocity,
        "body_pos_w": place.reshape(-1, bodies, 3),
        "body_quat_w": turn.reshape(-1, bodies, 4),
    }


def prepare(tmp_path, motion, *options):
    arguments = ["--policy", str(POLICY), "--robot", str(ROBOT), "--motion", str(motion), *options]
    return run_program(main, [*arguments, "--output", str(tmp_path / "out")])


def test_the_saved_motion_is_the_graphs(tmp_path, waltz):
    np.savez(tmp_path / "waltz.npz", **parts(waltz))
    assert prepare(tmp_path, tmp_path / "waltz.npz") == 0
    made = read_motion(tmp_path / "out" / "waltz.mcap")
    assert (made.layout, made.joint_names, made.body_names) == (waltz.layout, waltz.joint_names, waltz.body_names)
    np.testing.assert_allclose(made.frames, waltz.frames, atol=1e-6)
    report = json.loads((tmp_path / "out" / "waltz.json").read_text())
    assert max(body["position_max"] for body in report["bodies"]) < 1e-4
    assert max(body["angle_max"] for body in report["bodies"]) < 1e-3


def test_joints_in_another_order(tmp_path, waltz, capsys):
    state = parts(waltz)
    order = np.random.default_rng(0).permutation(29)
    permuted = state | {key: state[key][:, order] for key in ("joint_pos", "joint_vel")}
    np.savez(tmp_path / "waltz.npz", **permuted)
    assert prepare(tmp_path, tmp_path / "waltz.npz") == 2
    assert "bodies are off" in capsys.readouterr().err
    named = ",".join(waltz.joint_names[i] for i in order)
    assert prepare(tmp_path, tmp_path / "waltz.npz", "--joint-order", named) == 0
    made = parts(read_motion(tmp_path / "out" / "waltz.mcap"))
    np.testing.assert_allclose(made["joint_pos"], state["joint_pos"], atol=1e-6)


def test_bodies_in_another_order(tmp_path, waltz, capsys):
    order = np.random.default_rng(1).permutation(14)
    state = parts(waltz)
    np.savez(tmp_path / "waltz.npz", **(state | {key: state[key][:, order] for key in ("body_pos_w", "body_quat_w")}))
    assert prepare(tmp_path, tmp_path / "waltz.npz") == 2
    assert "bodies are off" in capsys.readouterr().err
    named = ",".join(waltz.body_names[i] for i in order)
    assert prepare(tmp_path, tmp_path / "waltz.npz", "--body-order", named) == 0


@pytest.mark.parametrize("xyzw", [True, False])
def test_the_same_as_a_csv(tmp_path, waltz, capsys, xyzw):
    state = parts(waltz)
    robot_order = [waltz.joint_names.index(joint) for joint in load_robot(ROBOT).joint_names]
    turn = state["body_quat_w"][:, 0]
    turn = np.roll(turn, -1, axis=-1) if xyzw else turn
    rows = np.concatenate([state["body_pos_w"][:, 0], turn, state["joint_pos"][:, robot_order]], axis=1)
    np.savetxt(tmp_path / "waltz.csv", rows, delimiter=",")
    if not xyzw:
        assert prepare(tmp_path, tmp_path / "waltz.csv", "--fps", "50") == 2
        assert "it would be upright with --quaternions wxyz" in capsys.readouterr().err
    options = [] if xyzw else ["--quaternions", "wxyz"]
    assert prepare(tmp_path, tmp_path / "waltz.csv", "--fps", "50", *options) == 0
    made = parts(read_motion(tmp_path / "out" / "waltz.mcap"))
    np.testing.assert_allclose(made["joint_pos"], state["joint_pos"], atol=1e-6)
    np.testing.assert_allclose(made["body_pos_w"], state["body_pos_w"], atol=1e-4)
    sign = np.sign((made["body_quat_w"] * state["body_quat_w"]).sum(axis=-1, keepdims=True))
    np.testing.assert_allclose(sign * made["body_quat_w"], state["body_quat_w"], atol=1e-4)


def test_a_csv_in_the_policys_order(tmp_path, waltz, capsys):
    state = parts(waltz)
    turn = np.roll(state["body_quat_w"][:, 0], -1, axis=-1)
    rows = np.concatenate([state["body_pos_w"][:, 0], turn, state["joint_pos"]], axis=1)
    np.savetxt(tmp_path / "waltz.csv", rows, delimiter=",")
    assert prepare(tmp_path, tmp_path / "waltz.csv", "--fps", "50") == 2
    assert "beyond its limits" in capsys.readouterr().err
    assert prepare(tmp_path, tmp_path / "waltz.csv", "--fps", "50", "--joint-order", "contract") == 0


def test_a_policy_that_carries_its_motion_needs_none(tmp_path, capsys):
    arguments = ["--policy", str(POLICY), "--robot", str(ROBOT), "--output", str(tmp_path / "out")]
    assert run_program(main, arguments) == 0
    assert "carries its motion itself; nothing else to prepare" in capsys.readouterr().out
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["Waltz.onnx"]


def test_a_policy_that_needs_files_beside_it_stays_where_it_is(tmp_path, capsys):
    policy = POLICIES / TRACES["unitree"][0]
    arguments = ["--policy", str(policy), "--robot", str(ROBOT), "--output", str(tmp_path / "out")]
    assert run_program(main, arguments) == 0
    assert not list((tmp_path / "out").glob("*"))
    assert "is not copied" in capsys.readouterr().out
