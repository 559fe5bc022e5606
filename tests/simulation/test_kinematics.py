import mujoco
import numpy as np
import pytest
from motion_samples import BODIES, joint_path, pose_a

from humanoid_sim.controllers.rotation import rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import AnchorOrientation, ForwardKinematics, GravityTorque, InverseKinematics
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot

ON_A_TILTED_BASE = """
<mujoco>
  <worldbody>
    <body name="base" pos="1 2 3" euler="0 0 90">
      <site name="imu"/>
      <body name="arm">
        <joint name="hinge" axis="0 0 1"/>
        <geom size="0.1"/>
        <body name="tip" pos="0.5 0 0"><geom size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_poses_are_in_the_base_frame(small_robot):
    kinematics = ForwardKinematics(small_robot(ON_A_TILTED_BASE, ("hinge",)), ("tip", "base"))
    positions, rotations = kinematics(np.array([np.pi / 2]))
    np.testing.assert_allclose(positions, [[0, 0.5, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(rotations[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(rotations[1], np.eye(3), atol=1e-12)
    with pytest.raises(InputError, match=r"^lite: unknown body 'left_paw'.*; known: chest, left_shoulder_pitch, "):
        ForwardKinematics(load_robot("lite"), ("left_paw",))


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_is_the_bias_of_a_robot_at_rest(name):
    robot = load_robot(name)
    gravity = GravityTorque(robot)
    model = build_model(robot)
    data = mujoco.MjData(model)
    for position in np.random.default_rng(5).uniform(robot.lower, robot.upper, (20, robot.joint_count)):
        data.qpos[:] = position
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(gravity(position), data.qfrc_bias, rtol=0, atol=1e-12)


def test_the_joints_of_a_motion_are_found_from_its_bodies():
    lite = load_robot("lite")
    path = joint_path(120)
    position, rotation = ForwardKinematics(lite, BODIES)(path)
    solution = InverseKinematics(lite, BODIES, damping=1e-3).solve_path(position, rotation, pose_a(lite))
    np.testing.assert_allclose(solution, path, atol=1e-4)


def test_hands_alone_leave_the_elbows_to_the_posture():
    lite = load_robot("lite")
    kinematics = ForwardKinematics(lite)
    position, rotation = kinematics(pose_a(lite))
    target = position + np.array([0.05, 0.0, 0.05])
    solver = InverseKinematics(lite, lite.hands)
    solution = solver.solve(target, rotation, pose_a(lite), posture=pose_a(lite), iterations=100)
    reached, turned = kinematics(solution)
    np.testing.assert_allclose(reached, target, atol=1e-3)
    assert rotation_angle(turned, rotation).max() < 5e-3


@pytest.mark.parametrize(("name", "body"), [("lite", "left_hand"), ("lite_biped", "left_foot")])
def test_imu_and_joints_give_the_orientation_that_a_simulation_knows(name, body):
    """However the base stands."""
    robot, rng = load_robot(name), np.random.default_rng(3)
    simulated = SimRobot(robot, SimConfig(anchor_body=body))
    qpos = simulated.qpos
    qpos[-robot.joint_count :] = rng.uniform(-0.5, 0.5, robot.joint_count)
    if robot.is_floating:
        turn = rng.normal(size=4)
        qpos[3:7] = turn / np.linalg.norm(turn)
    simulated.reset(qpos)
    state = simulated.state()
    measured = AnchorOrientation(robot, body).read(state.joint_position, state.imu_quaternion)
    assert abs(measured @ state.extern["anchor_pose"].value[3:]) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(InputError, match="anchor body"):
        AnchorOrientation(robot, "tail")
