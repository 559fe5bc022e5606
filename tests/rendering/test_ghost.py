from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.messages import Mode
from humanoid_sim.policy.motion import body_poses, read_motion
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import build_model, joint_addresses

RECORDING = Path(__file__).parents[1] / "data" / "recordings" / "simulated_locomotion.mcap"
WALKER = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1"><freejoint/><geom size="0.1"/>
      <body name="chest" pos="0 0 0.3"><joint name="waist" axis="0 0 1"/><geom size="0.1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def ghost_of_wave():
    """The Lite, the ghost of a sample motion, its bodies and their positions (F, b, 3)."""
    lite, motion = load_robot("lite"), read_motion(asset_path("motions", "wave.mcap"))
    bodies, wide = motion.body_names, 3 * len(motion.body_names)
    terms = {"motion_body_pos_b": motion.frames[:, :wide], "motion_body_ori_b": motion.frames[:, wide:]}
    contract = SimpleNamespace(joint_names=lite.joint_names, body_names=bodies, align_reference=False)
    ghost = ReferenceGhost(lite, contract, MotionReference(len(motion.frames), terms))
    return lite, ghost, bodies, body_poses(motion.frames, len(bodies))[0]


def test_a_motion_of_bodies_is_reached_by_the_ghosts_joints():
    lite, ghost, bodies, wanted = ghost_of_wave()
    model = build_model(lite)
    addresses, kinematics = joint_addresses(model, lite.joint_names).qpos, ForwardKinematics(lite, bodies)
    qpos = model.qpos0.copy()
    for frame in range(0, 201, 10):
        qpos = ghost.pose(model, qpos, frame)
        assert np.abs(kinematics(qpos[addresses])[0] - wanted[frame]).max() < 0.002


@pytest.mark.parametrize("aligned", [False, True])
def test_the_base_is_where_the_anchor_body_needs_it(aligned):
    model, half = mujoco.MjModel.from_xml_string(WALKER), np.sqrt(0.5)
    terms = {
        "reference_joint_pos": np.array([[0.0], [0.5]]),
        "anchor_pos": np.array([[0.0, 0.0, 1.3], [1.0, 0.0, 1.2]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    }
    reference = MotionReference(2, terms)
    contract = SimpleNamespace(joint_names=("waist",), anchor_body="chest", align_reference=aligned)
    ghost = ReferenceGhost(SimpleNamespace(joint_names=("waist",)), contract, reference)
    alignment = reference.align(np.array([5.0, 0.0, 1.25, half, 0.0, 0.0, half])) if aligned else None  # looks along +y
    data = mujoco.MjData(model)
    data.qpos[:] = ghost.pose(model, model.qpos0, 1, alignment)
    mujoco.mj_kinematics(model, data)
    assert data.qpos[7] == pytest.approx(0.5)
    where, heading = ([5.0, 1.0, 1.2], [half, 0.0, 0.0, half]) if aligned else ([1.0, 0.0, 1.2], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(data.body("chest").xpos, where, atol=1e-6)
    np.testing.assert_allclose(data.body("chest").xquat, heading, atol=1e-6)


def test_the_frame_that_is_shown_is_the_latest_that_the_policy_saw():
    _, ghost, _, _ = ghost_of_wave()
    frames = {True: [], False: []}
    for record in open_recording(RECORDING).ticks():
        ghost.update(record)
        frames[record.output.control_mode.mode is Mode.LOCOMOTION].append(ghost.frame)
    assert frames[True] == list(range(52))
    assert set(frames[False]) == {None}
