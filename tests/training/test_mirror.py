import numpy as np

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.training.mirror import ORIENTATION_SIGN, POSITION_SIGN, arm_joints, both_arms
from humanoid_sim.training.motions import BODIES


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
