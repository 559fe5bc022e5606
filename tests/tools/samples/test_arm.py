import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import build_model
from tools.samples.arm import ORIENTATION_SIGN, POSITION_SIGN, arm_joints, both_arms
from tools.samples.motions import BODIES

LEFT_BODIES = ("left_elbow_pitch", "left_hand")


@pytest.fixture(scope="module")
def poses(arm):
    rng = np.random.default_rng(5)
    return np.stack([arm.sample(rng) for _ in range(10)])


def test_poses_are_those_of_the_robots_kinematics(arm, poses):
    position, rotation = arm.poses(poses)
    expected = ForwardKinematics(load_robot("lite"), LEFT_BODIES)(both_arms(poses, poses))
    np.testing.assert_allclose(position, expected[0], atol=1e-12)
    np.testing.assert_allclose(rotation, expected[1], atol=1e-12)


def test_jacobians_are_the_derivatives_of_the_poses(arm, poses):
    step = 1e-6
    jacobian = arm.jacobians(poses)
    position, _ = arm.poses(poses)
    for joint in range(7):
        moved, _ = arm.poses(poses + step * np.eye(7)[joint])
        np.testing.assert_allclose((moved - position) / step, jacobian[:, :, :3, joint], atol=1e-5)


def test_dynamics_are_the_whole_robots_with_the_other_arm_at_rest(arm, poses):
    lite = load_robot("lite")
    model = build_model(lite, scene=False)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(6)
    velocity, acceleration = rng.normal(size=(2, len(poses), 7))
    mass, bias = arm.dynamics(poses, velocity)
    for i, q in enumerate(poses):
        data.qpos[:] = both_arms(q, arm.home)
        data.qvel[:7], data.qacc[:7] = velocity[i], acceleration[i]
        torque = np.empty(14)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rne(model, data, 1, torque)
        torque[:7] += model.dof_armature[:7] * acceleration[i]
        np.testing.assert_allclose(mass[i] @ acceleration[i] + bias[i], torque[:7], atol=1e-9)


def test_sampled_poses_are_free_and_within_limits(arm, poses):
    assert (poses > arm.lower).all()
    assert (poses < arm.upper).all()
    assert not any(arm.collides(q) for q in poses)


def test_an_arm_in_the_head_collides(arm):
    rng = np.random.default_rng(7)
    samples = rng.uniform(arm.lower, arm.upper, (300, 7))
    share = np.mean([arm.collides(q) for q in samples])
    assert 0.05 < share < 0.4  # the source's own count, both arms together, is 0.32


def test_the_right_arm_is_the_left_arms_mirror_image():
    rng = np.random.default_rng(3)
    left = rng.uniform(-0.6, 0.0, (20, 7))
    position, rotation = ForwardKinematics(load_robot("lite"), BODIES)(both_arms(left, left))
    np.testing.assert_allclose(position[:, 2:] * POSITION_SIGN, position[:, :2], atol=1e-5)
    np.testing.assert_allclose(rotation[:, 2:, :, :2] * ORIENTATION_SIGN, rotation[:, :2, :, :2], atol=2e-5)


def test_splitting_undoes_joining():
    rng = np.random.default_rng(4)
    left, right = rng.normal(size=(2, 5, 7))
    arms = arm_joints(both_arms(left, right))
    np.testing.assert_array_equal(arms, np.stack([left, right], axis=1))
