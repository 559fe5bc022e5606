import numpy as np
import pytest

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.plant import make_plant
from tools.samples.arm import both_arms
from tools.samples.motions import derivative
from tools.samples.random_motions import PERIOD, random_motions
from tools.samples.teacher import Plants, error_weight, exact_command, training_motions, training_poses


@pytest.fixture(scope="module")
def path(arm):
    paths = random_motions(arm, np.random.default_rng(11))
    return next(path for path in paths if np.abs(derivative(path, PERIOD)).max() > 2.0)


def test_the_exact_command_makes_the_simulated_arm_follow(arm, path):
    """Held for a policy step each, on the real plant with friction and limits: below half a degree of error."""
    lite = load_robot("lite")
    velocity = derivative(path, PERIOD)
    acceleration = derivative(velocity, PERIOD)
    mass, bias = arm.dynamics(path, velocity)
    torque = np.einsum("fij,fj->fi", mass, acceleration) + bias
    command = exact_command(arm, path, velocity, torque, arm.stiffness, arm.damping)

    plant = make_plant(lite, actuation="affine")
    plant.data.qpos[:] = both_arms(path[0], arm.home)
    plant.data.qvel[:7] = velocity[0]
    zeros = np.zeros(14)
    errors = []
    for k in range(0, 600, 2):
        errors.append(plant.position[:7] - path[k])
        plant.apply(MITCommand(both_arms(command[k + 1], arm.home), zeros, zeros, lite.stiffness, lite.damping))
        plant.step(40)
    assert np.sqrt(np.mean(np.square(errors))) < np.radians(0.5)


def test_training_motions_are_cut_at_policy_steps_and_their_middles(arm, path):
    motions = training_motions(arm, [path, path], np.random.default_rng(0))
    assert motions.joint_position.shape == (2, 400, 7)
    np.testing.assert_array_equal(motions.joint_position[1], path[::2])
    np.testing.assert_allclose(motions.body_position[0], arm.poses(path[::2])[0])
    assert motions.weight.shape == (2, 400, 7, 7)
    assert np.abs(motions.plants.stiffness / arm.stiffness - 1.0).max() <= 0.12
    # The same motion on two plants takes two different commands.
    assert np.abs(motions.command[0] - motions.command[1]).max() > 1e-3


def test_the_weight_is_the_cost_of_the_body_errors(arm):
    q = arm.home[None]
    jacobian = arm.jacobians(q)
    weight = error_weight(jacobian)[0]
    step = np.array([0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0])  # the elbow's joint: the elbow turns, the hand moves as well
    elbow, hand = jacobian[0] @ step
    units = np.array([0.03] * 3 + [0.2] * 3), np.array([0.01] * 3 + [0.08] * 3)
    expected = (np.sum((elbow / units[0]) ** 2) + np.sum((hand / units[1]) ** 2)) / 12 + np.sum((step / 0.33) ** 2)
    assert step @ weight @ step == pytest.approx(expected)


def test_poses_carry_the_sag_of_a_held_command(arm):
    poses = training_poses(arm, 5, np.random.default_rng(1))
    _, gravity = arm.dynamics(poses.joint_position, np.zeros((5, 7)))
    np.testing.assert_allclose(poses.sag * arm.stiffness, gravity)


def test_plants_differ_by_no_more_than_they_say(arm):
    plants = Plants.sample(arm, np.random.default_rng(2), 200)
    assert np.abs(plants.damping / arm.damping - 1.0).max() == pytest.approx(0.12, abs=0.005)
    assert np.abs(plants.inertia - 1.0).max() == pytest.approx(0.1, abs=0.005)
