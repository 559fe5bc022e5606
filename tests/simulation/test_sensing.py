"""The sensors of a robot that moves, and of one that cannot, against hand-computed values and MuJoCo's kinematics."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot

BOX = """
<mujoco>
  <option density="0"/>
  <worldbody>
    <body name="box" pos="0 0 5">
      <freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
      <site name="imu" pos="0.2 0 0"/>
      <site name="tilted" euler="90 0 0"/>
      <body name="wheel"><joint name="spin" armature="1"/><geom size="0.01" mass="1e-6"/></body>
    </body>
  </worldbody>
</mujoco>
"""
FLOATING = {"type": "floating", "body": "box"}
STEP = {"physics_timestep": 0.0001, "control_frequency": 10000}


def sensed(small_robot, imu="imu", qvel=None, lift=0.0):
    """The IMU after one physics step of a free box at a velocity (7,), under an upward force, N."""
    robot = SimRobot(small_robot(BOX, ("spin",), imu=imu, base=FLOATING, simulation=STEP))
    robot.reset(robot.model.qpos0, qvel)  # high above the floor
    robot.data.xfrc_applied[robot.model.body("box").id, 2] = lift
    robot.write(MITCommand.zeros(1))
    return robot.state()


def test_free_fall_weighs_nothing_and_support_is_felt_in_the_imu_s_own_frame(small_robot):
    state = sensed(small_robot)
    assert state.imu_quaternion == pytest.approx([1, 0, 0, 0], abs=1e-12)
    assert state.imu_linear_acceleration == pytest.approx([0, 0, 0], abs=1e-6)
    assert sensed(small_robot, lift=9.81).imu_linear_acceleration == pytest.approx([0, 0, 9.81], abs=1e-4)
    rolled = sensed(small_robot, "tilted", lift=9.81)  # by 90° about x: its y axis points up
    assert rolled.imu_quaternion == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 0, 0], abs=1e-9)
    assert rolled.imu_linear_acceleration == pytest.approx([0, 9.81, 0], abs=1e-4)


def test_a_spin_is_a_centripetal_acceleration_and_an_angular_velocity_in_the_imu_frame(small_robot):
    spin = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0])
    state = sensed(small_robot, qvel=spin)
    assert state.imu_angular_velocity == pytest.approx([0, 0, 3.0], abs=1e-5)
    assert state.imu_linear_acceleration == pytest.approx([-0.2 * 3.0**2, 0, 0], abs=1e-4)
    assert sensed(small_robot, "tilted", spin).imu_angular_velocity == pytest.approx([0, 3.0, 0], abs=1e-5)


def test_an_imu_that_cannot_move_measures_gravity(small_robot):
    tilted = BOX.replace("<freejoint/>", "").replace('name="imu" pos="0.2 0 0"', 'name="imu" euler="0 90 0"')
    state = SimRobot(small_robot(tilted, ("spin",))).state()
    assert state.imu_quaternion == pytest.approx([np.sqrt(0.5), 0, np.sqrt(0.5), 0])
    assert state.imu_angular_velocity.tolist() == [0, 0, 0]
    assert state.imu_linear_acceleration == pytest.approx([-9.81, 0, 0])


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


@pytest.mark.parametrize("imu", ["hand", "arm", "trunk"])
def test_live_inputs_and_poses_are_those_of_the_present_state(small_robot, imu):
    """The velocity of a point is how its position changes; poses are `mj_kinematics`'s."""
    description = small_robot(ARM, ("shoulder",), imu=imu, base={"type": "floating", "body": "trunk"})
    robot = SimRobot(description, SimConfig(velocity_at=("imu", "hand"), anchor_body="arm", bodies=("arm", "trunk")))
    assert dict(robot.extern) == {
        "base_linear_velocity": 3,
        "base_linear_velocity_at_imu": 3,
        "base_linear_velocity_at_hand": 3,
        "anchor_pose": 7,
    }
    rng, data, later = np.random.default_rng(0), mujoco.MjData(robot.model), mujoco.MjData(robot.model)
    qpos, qvel = rng.normal(size=robot.model.nq), rng.normal(size=robot.model.nv)
    mujoco.mj_normalizeQuat(robot.model, qpos)
    robot.reset(qpos, qvel)
    for _ in range(3):
        robot.write(MITCommand.zeros(1))
    live = {name: extern.value for name, extern in robot.state().extern.items()}
    data.qpos[:] = later.qpos[:] = robot.qpos
    mujoco.mj_integratePos(robot.model, later.qpos, robot.data.qvel, 1e-6)
    for state in (data, later):
        mujoco.mj_kinematics(robot.model, state)

    def velocity(name):
        places = [state.site(name).xpos if name == "hand" else state.body(name).xpos for state in (data, later)]
        return (places[1] - places[0]) / 1e-6

    for name, point in ((BASE_LINEAR_VELOCITY, "trunk"), (f"{BASE_LINEAR_VELOCITY}_at_imu", imu)):
        np.testing.assert_allclose(live[name], velocity(point), rtol=0, atol=1e-4)
    np.testing.assert_allclose(live[f"{BASE_LINEAR_VELOCITY}_at_hand"], velocity("hand"), rtol=0, atol=1e-4)
    arm, trunk = data.body("arm"), data.body("trunk")
    assert live[ANCHOR_POSE] == pytest.approx([*arm.xpos, *arm.xquat], abs=1e-12)
    position, quaternion = robot.body_poses()
    np.testing.assert_allclose(position, [arm.xpos, trunk.xpos], rtol=0, atol=1e-12)
    np.testing.assert_allclose(quaternion, [arm.xquat, trunk.xquat], rtol=0, atol=1e-12)
    in_base, turns = robot.body_poses(in_base=True)
    expected = trunk.xmat.reshape(3, 3).T @ (arm.xpos - trunk.xpos)
    np.testing.assert_allclose(in_base, [expected, np.zeros(3)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(turns[1], [1.0, 0.0, 0.0, 0.0], rtol=0, atol=1e-12)
    assert robot.base.centre_of_mass == pytest.approx(
        (trunk.xpos + trunk.xmat.reshape(3, 3) @ [0.1, 0.2, 0.3] + mass(robot) * data.body("arm").xipos)
        / (1.0 + mass(robot)),
        abs=1e-9,
    )


def mass(robot):
    return float(robot.model.body("arm").mass[0])


def test_a_fixed_robot_has_an_anchor_and_no_velocity():
    robot = SimRobot(load_robot("lite"), SimConfig(anchor_body="chest", velocity_at=("imu",)))
    assert dict(robot.extern) == {ANCHOR_POSE: 7}
    assert robot.state().extern[ANCHOR_POSE].value.tolist() == [0, 0, 0, 1, 0, 0, 0]
    assert robot.base is None
