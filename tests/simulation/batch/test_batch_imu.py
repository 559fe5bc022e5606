"""The IMU of a batch against that of one robot."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch.imu import BatchImu
from humanoid_sim.simulation.imu import Imu
from humanoid_sim.simulation.model import build_model

ON_A_LIMB = """
<mujoco>
  <option gravity="1 2 -9"/>
  <worldbody>
    <body name="trunk">
      <freejoint/>
      <geom size="0.1"/>
      <body name="limb" pos="0.2 0.1 0" euler="30 0 20">
        <joint type="slide" axis="0 1 1"/>
        <joint type="hinge" axis="1 0 1" pos="0.1 0.2 0.3"/>
        <geom size="0.1"/>
        <body name="hand" pos="0 0 0.4">
          <joint type="ball" pos="0.05 0 0"/>
          <geom size="0.1"/>
          <site name="imu" pos="0.3 0.2 0.1" euler="70 10 40"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("frame", ["imu", "hand", "limb", "trunk"])
def test_readings_are_those_of_one_imu(frame: str) -> None:
    model = mujoco.MjModel.from_xml_string(ON_A_LIMB)
    generator = np.random.default_rng(0)
    qpos = generator.normal(size=(40, model.nq))
    qvel, qacc = generator.normal(size=(2, 40, model.nv))
    reading = BatchImu(model, frame).read(qpos, qvel, qacc)
    single, data = Imu(model, frame), mujoco.MjData(model)
    for i in range(len(qpos)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[i], qvel[i], qacc[i]
        expected = single.read(data)
        # The sign of the quaternion too: a policy that sees it was trained with one of the two.
        np.testing.assert_allclose(reading.quaternion[i], expected.quaternion, rtol=0, atol=1e-12)
        np.testing.assert_allclose(reading.angular_velocity[i], expected.angular_velocity, rtol=0, atol=1e-12)
        np.testing.assert_allclose(reading.linear_acceleration[i], expected.linear_acceleration, rtol=0, atol=1e-11)


def test_a_robot_on_a_stand_feels_gravity_only() -> None:
    robot = load_robot("lite")
    model = build_model(robot, scene=False)
    reading = BatchImu(model, robot.imu).read(*np.ones((3, 2, 14)))
    expected = Imu(model, robot.imu).read(mujoco.MjData(model))
    np.testing.assert_allclose(reading.quaternion, [expected.quaternion] * 2, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(reading.angular_velocity, np.zeros((2, 3)))
    np.testing.assert_allclose(reading.linear_acceleration, [expected.linear_acceleration] * 2, rtol=0, atol=1e-14)


def test_an_unknown_frame_is_refused() -> None:
    with pytest.raises(InputError, match="imu: 'nose' is neither a site nor a body of the model"):
        BatchImu(mujoco.MjModel.from_xml_string(ON_A_LIMB), "nose")
