"""The IMU of a body that moves freely, and of one that cannot; live inputs."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.simulation.sensors import Imu

FREE = """
<mujoco>
  <option timestep="0.0001" integrator="Euler"/>
  <worldbody>
    <site name="wall" euler="0 0 90"/>
    <body name="box">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
      <site name="imu" pos="0.2 0 0"/>
      <site name="tilted" euler="90 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(FREE)


def after_one_step(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mujoco.mj_step(model, data)
    sample = Imu(model, name).read(data)
    return sample.quaternion, sample.angular_velocity, sample.linear_acceleration


def test_free_fall_weighs_nothing(model: mujoco.MjModel) -> None:
    quaternion, angular_velocity, acceleration = after_one_step(model, mujoco.MjData(model), "imu")
    assert quaternion == pytest.approx([1, 0, 0, 0], abs=1e-12)
    assert angular_velocity == pytest.approx([0, 0, 0], abs=1e-12)
    assert acceleration == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_body_held_up_feels_gravity_in_its_own_frame(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qfrc_applied[2] = 9.81
    assert after_one_step(model, data, "imu")[2] == pytest.approx([0, 0, 9.81], abs=1e-9)
    # Rolled by 90° about x: its y axis points up.
    quaternion, _, acceleration = after_one_step(model, data, "tilted")
    assert quaternion == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0, 0], abs=1e-9)
    assert acceleration == pytest.approx([0, 9.81, 0], abs=1e-9)


def test_a_spinning_body_feels_the_centripetal_acceleration(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qvel[5] = 3.0
    _, angular_velocity, acceleration = after_one_step(model, data, "imu")
    assert angular_velocity == pytest.approx([0, 0, 3.0], abs=1e-9)
    assert acceleration == pytest.approx([-0.2 * 3.0**2, 0, 0], abs=1e-6)


def test_angular_velocity_is_in_the_imu_frame(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qvel[5] = 3.0
    assert after_one_step(model, data, "tilted")[1] == pytest.approx([0, 3.0, 0], abs=1e-9)


def test_it_is_as_new_as_the_state(model: mujoco.MjModel) -> None:
    """Where MuJoCo's own sensors would show the state before the step."""
    data = mujoco.MjData(model)
    data.qfrc_applied[5] = 1000.0  # 10 000 rad/s²: 1 rad/s in this one step
    _, angular_velocity, _ = after_one_step(model, data, "imu")
    assert angular_velocity == pytest.approx([0, 0, 1.0], abs=1e-6)


def test_a_body_can_be_an_imu(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    data.qvel[5] = 3.0
    assert after_one_step(model, data, "box")[2] == pytest.approx([0, 0, 0], abs=1e-6)


def test_a_body_s_axes_are_its_own_wherever_its_mass_is() -> None:
    lopsided = FREE.replace('pos="0 0 0" mass="1"', 'pos="0.1 0.2 0.3" euler="20 30 40" mass="1"')
    model = mujoco.MjModel.from_xml_string(lopsided.replace('<site name="tilted"', '<site name="origin"/><site'))
    data = mujoco.MjData(model)
    data.qpos[3:], data.qvel[:] = [0.5, 0.1, -0.7, 0.5], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    mujoco.mj_step(model, data)
    body, site = Imu(model, "box").read(data), Imu(model, "origin").read(data)
    np.testing.assert_allclose(body.quaternion, site.quaternion, rtol=0, atol=1e-12)
    np.testing.assert_allclose(body.angular_velocity, site.angular_velocity, rtol=0, atol=1e-12)
    np.testing.assert_allclose(body.linear_acceleration, site.linear_acceleration, rtol=0, atol=1e-9)


def test_an_imu_on_the_world_never_moves(model: mujoco.MjModel) -> None:
    imu = Imu(model, "wall")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    sample = imu.read(data)
    assert sample is imu.read(data)
    assert sample.quaternion == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert sample.angular_velocity.tolist() == [0, 0, 0]
    assert sample.linear_acceleration == pytest.approx([0, 0, 9.81])


def test_an_unknown_frame(model: mujoco.MjModel) -> None:
    with pytest.raises(InputError, match=r"^imu: 'gyro' is neither a site nor a body of the model$"):
        Imu(model, "gyro")
