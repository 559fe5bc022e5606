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


def test_the_motion_of_a_graph_comes_back_from_a_file_of_its_trainer(tmp_path):
    """As mjlab's .npz, with quaternions of any sign, and as LAFAN1's .csv, of the base and the joints alone."""
    waltz = load_checkpoint(POLICY).motion
    joints, bodies = len(waltz.joint_names), len(waltz.body_names)

    def parts(motion):
        position, velocity, place, turn = np.split(motion.frames, np.cumsum([joints, joints, 3 * bodies]), axis=1)
        places, turns = place.reshape(-1, bodies, 3), turn.reshape(-1, bodies, 4)
        return {"joint_pos": position, "joint_vel": velocity, "body_pos_w": places, "body_quat_w": turns}

    def prepared(path, *options):
        given = ["--policy", str(POLICY), "--robot", str(ROBOT), "--motion", str(path), "--output", str(tmp_path)]
        assert run_program(main, [*given, "--overwrite", *options]) == 0
        return read_motion(tmp_path / "waltz.mcap")

    state = parts(waltz)
    signs = np.where(np.arange(len(waltz.frames)) % 3 == 1, -1.0, 1.0)[:, None, None]
    np.savez(tmp_path / "waltz.npz", **{**state, "fps": np.array([50]), "body_quat_w": signs * state["body_quat_w"]})
    made = prepared(tmp_path / "waltz.npz")
    assert (made.layout, made.joint_names, made.body_names) == (waltz.layout, waltz.joint_names, waltz.body_names)
    np.testing.assert_allclose(made.frames, waltz.frames, atol=1e-6)

    order = [waltz.joint_names.index(joint) for joint in load_robot(ROBOT).joint_names]
    turn = np.roll(state["body_quat_w"][:, 0], -1, axis=-1)
    rows = np.concatenate([state["body_pos_w"][:, 0], turn, state["joint_pos"][:, order]], axis=1)
    np.savetxt(tmp_path / "waltz.csv", rows, delimiter=",")
    options = ("--fps", "50", "--joint-order", "robot", "--quaternions", "xyzw")
    again = parts(prepared(tmp_path / "waltz.csv", *options))
    np.testing.assert_allclose(again["joint_pos"], state["joint_pos"], atol=1e-6)
    np.testing.assert_allclose(again["body_pos_w"], state["body_pos_w"], atol=1e-4)
    assert np.abs((again["body_quat_w"] * state["body_quat_w"]).sum(axis=-1)).min() > 1.0 - 1e-6
