from pathlib import Path

import mujoco
import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.messages import Mode
from humanoid_sim.mit import MITCommand
from humanoid_sim.policy.motion import body_poses, read_motion
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference, commanded_pose
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import build_model, joint_addresses

RECORDING = Path(__file__).parents[1] / "data" / "recordings" / "simulated_locomotion.mcap"


def test_a_motion_of_bodies_is_reached_by_the_ghosts_joints():
    lite, motion = load_robot("lite"), read_motion(asset_path("motions", "wave.mcap"))
    bodies = motion.body_names
    wide = 3 * len(bodies)
    terms = {"motion_body_pos_b": motion.frames[:, :wide], "motion_body_ori_b": motion.frames[:, wide:]}
    ghost = ReferenceGhost(lite, lite.joint_names, bodies, "", False, MotionReference(len(motion.frames), terms))
    model = build_model(lite)
    addresses, kinematics = joint_addresses(model, lite.joint_names).qpos, ForwardKinematics(lite, bodies)
    own = mujoco.MjData(model).qpos.copy()
    wanted = body_poses(motion.frames, len(bodies))[0]
    for frame in range(0, 201, 10):
        reached = kinematics(ghost.pose(model, own, frame)[addresses])[0]
        assert np.abs(reached - wanted[frame]).max() < 0.002


WALKER = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><freejoint/><geom size="0.1"/>
      <body name="chest" pos="0 0 0.3"><joint name="waist" axis="0 0 1"/><geom size="0.1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("aligned", [False, True])
def test_the_base_is_where_the_anchor_body_needs_it(aligned, monkeypatch):
    model = mujoco.MjModel.from_xml_string(WALKER)
    half = np.sqrt(0.5)
    terms = {
        "reference_joint_pos": np.array([[0.0], [0.5]]),
        "anchor_pos": np.array([[0.0, 0.0, 1.3], [1.0, 0.0, 1.2]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    }

    class Description:
        joint_names = ("waist",)

    ghost = ReferenceGhost(Description(), ("waist",), (), "chest", aligned, MotionReference(2, terms))
    assert ghost.has_place is not aligned
    ghost.align(np.array([5.0, 0.0, 1.25, half, 0.0, 0.0, half]))  # the robot looks along +y, 5 m away
    assert ghost.has_place
    pose = ghost.pose(model, mujoco.MjData(model).qpos.copy(), 1)
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(model, data)
    assert pose[7] == pytest.approx(0.5)
    where, heading = ([5.0, 1.0, 1.2], [half, 0.0, 0.0, half]) if aligned else ([1.0, 0.0, 1.2], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(data.body("chest").xpos, where, atol=1e-6)
    np.testing.assert_allclose(data.body("chest").xquat, heading, atol=1e-6)


def test_a_command_pulls_joints_that_have_a_stiffness():
    model = mujoco.MjModel.from_xml_string(WALKER)
    addresses, own = joint_addresses(model, ("waist",)), mujoco.MjData(model).qpos.copy()
    zero, one = np.zeros(1), np.ones(1)
    pulled = commanded_pose(MITCommand(0.4 * one, zero, zero, 50.0 * one, one), own, addresses)
    assert pulled.tolist() == [*own[:7].tolist(), 0.4]
    assert commanded_pose(MITCommand(0.4 * one, zero, zero, zero, one), own, addresses) is None


def test_the_frame_that_is_shown_is_the_latest_that_the_policy_saw():
    shown, seen, modes = ShownReference(), [], []
    for record in open_recording(RECORDING).ticks():
        shown.look(record)
        seen.append(shown.frame)
        modes.append(record.output.control_mode.mode)
    driven = [frame for frame, mode in zip(seen, modes, strict=True) if mode is Mode.LOCOMOTION]
    assert driven == list(range(52))
    assert {frame for frame, mode in zip(seen, modes, strict=True) if mode is not Mode.LOCOMOTION} == {None}
