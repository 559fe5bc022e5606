"""What a batch measures against what MuJoCo gives one robot at the same state."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.physics import BatchPhysics, ModelPool
from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.batch.sensors import BatchSensors
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.sensors import Imu

COUNT = 40

EVERY_JOINT = """
<mujoco>
  <option gravity="1 2 -9"/>
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
    <body name="trunk">
      <freejoint/>
      <geom size="0.1" pos="0.3 0 0"/>
      <body name="limb" pos="0.2 0.1 0" euler="30 0 20">
        <joint name="slide" type="slide" axis="0 1 1"/>
        <joint name="hinge" type="hinge" axis="1 0 1" pos="0.1 0.2 0.3"/>
        <geom size="0.1 0.2 0.3" type="box" euler="10 20 30" pos="0.1 0.2 0"/>
        <body name="hand" pos="0 0 0.4">
          <joint type="ball" pos="0.05 0 0"/>
          <geom size="0.1"/>
          <site name="imu" pos="0.3 0.2 0.1" euler="70 10 40"/>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor><gyro site="imu"/></sensor>
</mujoco>
"""


def sensors_of(robot, bodies, anchor_body=""):
    """At a random state; quaternions are of any length, as integration leaves them."""
    model = build_model(robot, affine_actuators=True, scene=False)
    physics = BatchPhysics(ModelPool(model, COUNT), COUNT, 1, 2, 1)
    addresses = joint_addresses(model, robot.joint_names)
    draws = Draws(Randomisation(), COUNT)
    sensors = BatchSensors(physics, robot, addresses, draws, anchor_body=anchor_body, bodies=bodies)
    generator = np.random.default_rng(0)
    qpos, qvel = generator.normal(size=(COUNT, model.nq)), generator.normal(size=(COUNT, model.nv))
    physics.set(np.arange(COUNT), qpos, qvel)
    physics.acceleration[:] = 100.0 * generator.normal(size=(COUNT, model.nv))
    return physics, sensors, model


@pytest.mark.parametrize("frame", ["imu", "hand", "limb", "trunk"])
def test_the_imu_is_that_of_one_robot(small_robot, frame):
    base = {"type": "floating", "body": "trunk", "height": 1.0}
    robot = small_robot(EVERY_JOINT, ("slide", "hinge"), imu=frame, base=base)
    physics, sensors, model = sensors_of(robot, [])
    state = sensors.read(physics.now, sensors.measure(physics.now), np.zeros((COUNT, 2)), None)
    single, data = Imu(model, frame), mujoco.MjData(model)
    for i in range(COUNT):
        data.qpos[:], data.qvel[:], data.qacc[:] = physics.qpos[i], physics.qvel[i], physics.acceleration[i]
        expected = single.read(data)
        # The sign of the quaternion too: a policy that sees it was trained with one of the two.
        np.testing.assert_allclose(state.imu_quaternion[i], expected.quaternion, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.imu_angular_velocity[i], expected.angular_velocity, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.imu_linear_acceleration[i], expected.linear_acceleration, rtol=0, atol=1e-10)


def test_a_robot_on_a_stand_feels_gravity_only():
    robot = load_robot("lite")
    physics, sensors, model = sensors_of(robot, [])
    state = sensors.read(physics.now, sensors.measure(physics.now), np.zeros((COUNT, 14)), None)
    expected = Imu(model, robot.imu).read(mujoco.MjData(model))
    np.testing.assert_allclose(state.imu_quaternion, [expected.quaternion] * COUNT, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(state.imu_angular_velocity, np.zeros((COUNT, 3)))
    np.testing.assert_allclose(
        state.imu_linear_acceleration, [expected.linear_acceleration] * COUNT, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("source", ["lite", "lite_biped", "every joint"])
def test_poses_are_those_of_mj_kinematics(small_robot, source):
    robot = small_robot(EVERY_JOINT, ("slide", "hinge")) if source == "every joint" else load_robot(source)
    described = build_model(robot, scene=False)
    # The support is a mocap body, whose pose is not a function of qpos.
    bodies = [described.body(i).name for i in range(1, described.nbody) if described.body_mocapid[i] < 0]
    physics, sensors, model = sensors_of(robot, bodies, anchor_body=bodies[-1])
    measured = sensors.measure(physics.now)
    positions, quaternions = sensors.poses(measured, in_base=False)
    state = sensors.read(physics.now, measured, np.zeros((COUNT, robot.joint_count)), None)
    anchor = state.extern["anchor_pose"].value
    data = mujoco.MjData(model)
    ids = [model.body(name).id for name in bodies]
    for i in range(COUNT):
        data.qpos[:] = physics.qpos[i]
        mujoco.mj_kinematics(model, data)
        np.testing.assert_array_equal(positions[i], data.xpos[ids])
        np.testing.assert_array_equal(quaternions[i], data.xquat[ids])
        np.testing.assert_array_equal(anchor[i], np.concatenate([data.xpos[ids[-1]], data.xquat[ids[-1]]]))
