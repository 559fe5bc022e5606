"""Forward kinematics of a batch against MuJoCo's own, pose by pose."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch.body_tree import BodyTree, body_ids
from humanoid_sim.simulation.model import build_model

EVERY_JOINT = """
<mujoco>
  <worldbody>
    <body name="stand" pos="1 2 3" euler="10 20 30">
      <geom size="0.1"/>
      <body name="slider" pos="0.1 0.2 0.3" euler="0 40 0">
        <joint type="slide" axis="1 2 0" ref="0.3"/>
        <joint type="hinge" axis="0 1 1" pos="0.2 -0.1 0.05" ref="20"/>
        <geom size="0.1"/>
        <body name="ball" pos="0 0.5 0" euler="5 0 5">
          <joint type="ball" pos="0.1 0 0.2"/>
          <geom size="0.1"/>
          <body name="tip" pos="0.5 0 0" euler="0 0 90"><geom size="0.1"/></body>
        </body>
      </body>
    </body>
    <body name="flyer">
      <freejoint/>
      <geom size="0.1"/>
      <body name="tail" pos="-0.3 0 0.1">
        <joint type="hinge" axis="0 0 1"/>
        <joint type="hinge" axis="1 0 0" pos="0 0.1 0"/>
        <geom size="0.1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def random_qpos(model: mujoco.MjModel, count: int) -> FloatArray:
    """Shape (count, nq); quaternions are of any length, as integration leaves them."""
    return np.random.default_rng(0).normal(size=(count, model.nq))


@pytest.mark.parametrize("source", ["lite", "lite_biped", "every joint"])
def test_poses_are_those_of_mj_kinematics(source: str) -> None:
    if source == "every joint":
        model = mujoco.MjModel.from_xml_string(EVERY_JOINT)
    else:
        model = build_model(load_robot(source), scene=False)
    # The support is a mocap body, whose pose is not a function of qpos.
    bodies = [i for i in range(model.nbody) if model.body_mocapid[i] < 0]
    qpos = random_qpos(model, 25)
    poses = BodyTree(model, bodies).poses(qpos)
    data = mujoco.MjData(model)
    for row in range(len(qpos)):
        data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(model, data)
        for i in bodies:
            position = np.broadcast_to(poses[i].position, (3, len(qpos)))[:, row]
            quaternion = np.broadcast_to(poses[i].quaternion, (4, len(qpos)))[:, row]
            np.testing.assert_allclose(position, data.xpos[i], rtol=0, atol=1e-12)
            np.testing.assert_allclose(quaternion, data.xquat[i], rtol=0, atol=1e-12)


def test_only_the_chains_that_were_asked_for_are_walked() -> None:
    model = mujoco.MjModel.from_xml_string(EVERY_JOINT)
    slider = model.body("slider").id
    poses = BodyTree(model, [slider]).poses(random_qpos(model, 2))
    assert set(poses) == {0, model.body("stand").id, slider}


def test_an_unknown_body_is_named_with_those_that_exist() -> None:
    model = mujoco.MjModel.from_xml_string(EVERY_JOINT)
    assert body_ids(model, ["tail", "stand"]) == (6, 1)
    with pytest.raises(InputError, match=r"^unknown body 'head'; known: stand, slider, ball, tip, flyer, tail$"):
        body_ids(model, ["tail", "head"])


def test_motion_is_the_derivative_of_the_pose() -> None:
    """Five points in time of a path with constant accelerations, differentiated numerically."""
    model = mujoco.MjModel.from_xml_string(EVERY_JOINT)
    tip, tail = model.body("tip").id, model.body("tail").id
    tree = BodyTree(model, [tip, tail])
    qpos = random_qpos(model, 1)
    qvel, qacc = np.random.default_rng(1).normal(size=(2, 1, model.nv))
    h = 1e-3
    times = h * np.arange(-1, 2)
    path = np.tile(qpos, (3, 1))
    for row, t in zip(path, times, strict=True):
        # Not exact for quaternions: a turn at a changing rate is no one turn. That error is of third order in t.
        mujoco.mj_integratePos(model, row, (qvel * t + 0.5 * qacc * t * t)[0], 1.0)
    for body in (tip, tail):
        motion = tree.motion(body, qpos, qvel, qacc)
        before, now, after = tree.poses(path)[body].position.T
        np.testing.assert_allclose(motion.linear_acceleration[:, 0], (after - 2 * now + before) / h**2, atol=1e-4)
        quaternions = tree.poses(path)[body].quaternion.T
        turned = np.empty(3)
        relative, inverse = np.empty(4), np.empty(4)
        mujoco.mju_negQuat(inverse, quaternions[0])
        mujoco.mju_mulQuat(relative, quaternions[2], inverse)
        mujoco.mju_quat2Vel(turned, relative, 2 * h)
        np.testing.assert_allclose(motion.angular_velocity[:, 0], turned, atol=1e-4)
