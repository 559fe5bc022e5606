"""The motion inside a published tracking policy of the G1, in the world, as its trainer would have saved it."""

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
    joints, bodies = len(motion.joint_names), len(motion.body_names)
    position, velocity, place, turn = np.split(motion.frames, np.cumsum([joints, joints, 3 * bodies]), axis=1)
    return {
        "fps": np.array([50]),
        "joint_pos": position,
        "joint_vel": velocity,
        "body_pos_w": place.reshape(-1, bodies, 3),
        "body_quat_w": turn.reshape(-1, bodies, 4),
    }


def prepare(tmp_path, *options):
    arguments = ["--policy", str(POLICY), "--robot", str(ROBOT), "--output", str(tmp_path / "out"), *options]
    return run_program(main, arguments)


def test_the_saved_motion_is_the_graph_s(tmp_path, waltz):
    np.savez(tmp_path / "waltz.npz", **parts(waltz))
    assert prepare(tmp_path, "--motion", str(tmp_path / "waltz.npz")) == 0
    made = read_motion(tmp_path / "out" / "waltz.mcap")
    assert (made.layout, made.joint_names, made.body_names) == (waltz.layout, waltz.joint_names, waltz.body_names)
    np.testing.assert_allclose(made.frames, waltz.frames, atol=1e-6)


def test_quaternions_keep_their_sign_from_frame_to_frame(tmp_path, waltz):
    state = parts(waltz)
    flips = np.where(np.random.default_rng(0).random(state["body_quat_w"].shape[:2]) < 0.3, -1.0, 1.0)[..., None]
    flips[0] = 1.0
    np.savez(tmp_path / "waltz.npz", **(state | {"body_quat_w": flips * state["body_quat_w"]}))
    assert prepare(tmp_path, "--motion", str(tmp_path / "waltz.npz")) == 0
    turn = parts(read_motion(tmp_path / "out" / "waltz.mcap"))["body_quat_w"]
    assert (turn[1:] * turn[:-1]).sum(axis=-1).min() > 0.9


def test_the_same_from_the_joints_and_the_base(tmp_path, waltz):
    state = parts(waltz)
    order = [waltz.joint_names.index(joint) for joint in load_robot(ROBOT).joint_names]
    turn = np.roll(state["body_quat_w"][:, 0], -1, axis=-1)
    rows = np.concatenate([state["body_pos_w"][:, 0], turn, state["joint_pos"][:, order]], axis=1)
    np.savetxt(tmp_path / "waltz.csv", rows, delimiter=",")
    options = ["--motion", str(tmp_path / "waltz.csv"), "--fps", "50", "--joint-order", "robot"]
    assert prepare(tmp_path, *options, "--quaternions", "xyzw") == 0
    made = parts(read_motion(tmp_path / "out" / "waltz.mcap"))
    np.testing.assert_allclose(made["joint_pos"], state["joint_pos"], atol=1e-6)
    np.testing.assert_allclose(made["body_pos_w"], state["body_pos_w"], atol=1e-4)
    cosine = np.abs((made["body_quat_w"] * state["body_quat_w"]).sum(axis=-1))
    assert cosine.min() > 1.0 - 1e-6


def test_a_floating_robot_needs_the_pose_of_its_base(tmp_path, waltz, capsys):
    state = parts(waltz)
    bodies = {name: state[name][:, 1:] for name in ("body_pos_w", "body_quat_w")}
    np.savez(tmp_path / "waltz.npz", **(state | bodies))
    options = ["--motion", str(tmp_path / "waltz.npz"), "--body-order", ",".join(waltz.body_names[1:])]
    assert prepare(tmp_path, *options) == 2
    assert f"has no pose of the floating base '{waltz.body_names[0]}'" in capsys.readouterr().err
