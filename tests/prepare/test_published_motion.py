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
    place, turn = place.reshape(-1, bodies, 3), turn.reshape(-1, bodies, 4)
    rest = {"joint_pos": position, "joint_vel": velocity, "body_pos_w": place, "body_quat_w": turn}
    return {"fps": np.array([50]), **rest}


def prepare(path, *options):
    given = ["--policy", str(POLICY), "--robot", str(ROBOT), "--motion", str(path)]
    return run_program(main, [*given, "--output", str(path.parent / "out"), *options])


def test_the_saved_motion_is_the_graph_s_with_steady_quaternions(tmp_path, waltz):
    state, path = parts(waltz), tmp_path / "waltz.npz"
    signs = np.where(np.arange(len(waltz.frames)) % 3 == 1, -1.0, 1.0)[:, None, None]
    np.savez(path, **{**state, "body_quat_w": signs * state["body_quat_w"]})
    assert prepare(path) == 0
    made = read_motion(tmp_path / "out" / "waltz.mcap")
    assert (made.layout, made.joint_names, made.body_names) == (waltz.layout, waltz.joint_names, waltz.body_names)
    np.testing.assert_allclose(made.frames, waltz.frames, atol=1e-6)


def test_the_same_from_the_joints_and_the_base(tmp_path, waltz):
    state, path = parts(waltz), tmp_path / "waltz.csv"
    order = [waltz.joint_names.index(joint) for joint in load_robot(ROBOT).joint_names]
    turn = np.roll(state["body_quat_w"][:, 0], -1, axis=-1)
    rows = np.concatenate([state["body_pos_w"][:, 0], turn, state["joint_pos"][:, order]], axis=1)
    np.savetxt(path, rows, delimiter=",")
    assert prepare(path, "--fps", "50", "--joint-order", "robot", "--quaternions", "xyzw") == 0
    made = parts(read_motion(tmp_path / "out" / "waltz.mcap"))
    np.testing.assert_allclose(made["joint_pos"], state["joint_pos"], atol=1e-6)
    np.testing.assert_allclose(made["body_pos_w"], state["body_pos_w"], atol=1e-4)
    assert np.abs((made["body_quat_w"] * state["body_quat_w"]).sum(axis=-1)).min() > 1.0 - 1e-6
