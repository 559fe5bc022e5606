"""The IMU of a body that moves freely, and of one that cannot; live inputs."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.sensors import AnchorOrientation, BodySensors, Imu

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
def model():
    return mujoco.MjModel.from_xml_string(FREE)


def after_one_step(model, data, name):
    mujoco.mj_step(model, data)
    sample = Imu(model, name).read(data)
    return sample.quaternion, sample.angular_velocity, sample.linear_acceleration


def test_free_fall_weighs_nothing(model):
    quaternion, angular_velocity, acceleration = after_one_step(model, mujoco.MjData(model), "imu")
    assert quaternion == pytest.approx([1, 0, 0, 0], abs=1e-12)
    assert angular_velocity == pytest.approx([0, 0, 0], abs=1e-12)
    assert acceleration == pytest.approx([0, 0, 0], abs=1e-9)


def test_a_body_held_up_feels_gravity_in_its_own_frame(model):
    data = mujoco.MjData(model)
    data.qfrc_applied[2] = 9.81
    assert after_one_step(model, data, "imu")[2] == pytest.approx([0, 0, 9.81], abs=1e-9)
    # Rolled by 90° about x: its y axis points up.
    quaternion, _, acceleration = after_one_step(model, data, "tilted")
    assert quaternion == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0, 0], abs=1e-9)
    assert acceleration == pytest.approx([0, 9.81, 0], abs=1e-9)


def test_a_spinning_body_feels_the_centripetal_acceleration_and_angular_velocity_in_the_imu_frame(model):
    data = mujoco.MjData(model)
    data.qvel[5] = 3.0
    _, angular_velocity, acceleration = after_one_step(model, data, "imu")
    assert angular_velocity == pytest.approx([0, 0, 3.0], abs=1e-9)
    assert acceleration == pytest.approx([-0.2 * 3.0**2, 0, 0], abs=1e-6)
    data = mujoco.MjData(model)
    data.qvel[5] = 3.0
    assert after_one_step(model, data, "tilted")[1] == pytest.approx([0, 3.0, 0], abs=1e-9)


def test_a_body_s_axes_are_its_own_wherever_its_mass_is():
    lopsided = FREE.replace('pos="0 0 0" mass="1"', 'pos="0.1 0.2 0.3" euler="20 30 40" mass="1"')
    model = mujoco.MjModel.from_xml_string(lopsided.replace('<site name="tilted"', '<site name="origin"/><site'))
    data = mujoco.MjData(model)
    data.qpos[3:], data.qvel[:] = [0.5, 0.1, -0.7, 0.5], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    mujoco.mj_step(model, data)
    body, site = Imu(model, "box").read(data), Imu(model, "origin").read(data)
    np.testing.assert_allclose(body.quaternion, site.quaternion, rtol=0, atol=1e-12)
    np.testing.assert_allclose(body.angular_velocity, site.angular_velocity, rtol=0, atol=1e-12)
    np.testing.assert_allclose(body.linear_acceleration, site.linear_acceleration, rtol=0, atol=1e-9)


def test_an_imu_on_the_world_never_moves(model):
    imu = Imu(model, "wall")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    sample = imu.read(data)
    assert sample is imu.read(data)
    assert sample.quaternion == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    assert sample.angular_velocity.tolist() == [0, 0, 0]
    assert sample.linear_acceleration == pytest.approx([0, 0, 9.81])


ARM = """
<mujoco>
  <worldbody>
    <body name="trunk">
      <freejoint/>
      <inertial pos="0.1 0.2 0.3" euler="20 30 40" mass="1" diaginertia="0.1 0.12 0.14"/>
      <body name="arm" pos="0.3 0 0.1" euler="10 0 0">
        <joint name="shoulder" axis="0 1 1"/>
        <geom size="0.1" pos="0.1 0 0"/>
        <site name="hand" pos="0.2 0.1 0.3"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(("imu", "body"), [("hand", False), ("arm", True), ("trunk", True)])
def test_the_velocity_of_a_point_is_how_its_position_changes(small_robot, imu, body):
    robot = small_robot(ARM, ("shoulder",), imu=imu, base={"type": "floating", "body": "trunk"})
    model = build_model(robot, scene=False)
    data, later, rng = mujoco.MjData(model), mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:], data.qvel[:] = rng.normal(size=model.nq), rng.normal(size=model.nv)
    mujoco.mj_normalizeQuat(model, data.qpos)
    live = BodySensors(model, robot, velocity_at=("imu", "hand")).read(data).live
    later.qpos[:] = data.qpos
    mujoco.mj_integratePos(model, later.qpos, data.qvel, 1e-6)
    for state in (data, later):
        mujoco.mj_kinematics(model, state)

    def velocity(name, body):
        places = [state.body(name).xpos if body else state.site(name).xpos for state in (data, later)]
        return (places[1] - places[0]) / 1e-6

    np.testing.assert_allclose(live["base_linear_velocity"], velocity("trunk", True), rtol=0, atol=1e-5)
    np.testing.assert_allclose(live["base_linear_velocity_at_imu"], velocity(imu, body), rtol=0, atol=1e-5)
    np.testing.assert_allclose(live["base_linear_velocity_at_hand"], velocity("hand", False), rtol=0, atol=1e-5)


@pytest.mark.parametrize(("name", "body"), [("lite", "left_hand"), ("lite_biped", "left_foot")])
def test_imu_and_joints_give_the_orientation_that_a_simulation_knows(name, body):
    """However the base stands."""
    robot = load_robot(name)
    model, rng = build_model(robot, scene=False), np.random.default_rng(3)
    data, sensors = mujoco.MjData(model), BodySensors(model, robot, body)
    position = rng.uniform(-0.5, 0.5, robot.joint_count)
    data.qpos[joint_addresses(model, robot.joint_names).qpos] = position
    if robot.is_floating:
        turn = rng.normal(size=4)
        data.qpos[base_addresses(model, robot)[1]] = turn / np.linalg.norm(turn)
    sample = sensors.read(data)
    measured = AnchorOrientation(robot, body).read(position, sample.imu.quaternion)
    known = sample.live["anchor_pose"][3:]
    assert abs(measured @ known) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(InputError, match="anchor body"):
        AnchorOrientation(robot, "tail")
