"""The closed loop: one robot does what it does in a batch, and a restart touches nobody else."""

import numpy as np
import pytest

from humanoid_sim.envs.config import CONFIGS, build_scenario
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.sim_robot import SimRobot

STILL = np.zeros((2, 3))


@pytest.fixture(scope="module")
def scenario():
    return build_scenario(CONFIGS["lite_tracking"])


@pytest.fixture
def simulation(scenario):
    batch = BatchSim(scenario.description, 2, scenario.sim_config, threads=1)
    yield batch
    batch.close()


def actions(steps):
    return np.random.default_rng(0).normal(0.0, 0.3, (steps, 2, 14)).astype(np.float32)


def test_one_robot_goes_through_the_loop_as_a_batch_does(scenario, simulation):
    robot = SimRobot(scenario.description, scenario.sim_config)
    robot.reset()
    alone = ClosedLoop(robot, scenario.wiring, np.zeros(3))
    together = ClosedLoop(simulation, scenario.wiring, STILL)
    for action in actions(5):
        command = together.act(action)
        own = alone.act(action[1])
        np.testing.assert_allclose(own.position, command.position[1], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(alone.observation, together.observation[1], rtol=0.0, atol=1e-5)
        np.testing.assert_allclose(alone.state.joint_position, together.state.joint_position[1], rtol=0.0, atol=1e-9)
    assert alone.memory.frame == together.memory.frame[1] == 5
    robot.close()


def test_a_restart_is_a_fresh_start_for_those_that_are_chosen(scenario, simulation):
    loop = ClosedLoop(simulation, scenario.wiring, STILL)
    first = loop.observation.copy()
    for action in actions(3):
        loop.act(action)
    before = loop.observation[0].copy()
    simulation.reset([1])
    loop.restart(np.array([1]), STILL)
    assert np.asarray(loop.memory.frame).tolist() == [3, 0]
    np.testing.assert_array_equal(loop.observation[0], before)
    np.testing.assert_allclose(loop.observation[1], first[1], atol=1e-6)
    assert not loop.memory.last_action[1].any()
    assert loop.memory.last_action[0].any()


def test_a_sample_is_of_the_step_that_was_taken(scenario, simulation):
    loop = ClosedLoop(simulation, scenario.wiring, STILL)
    before, action = actions(2)
    loop.act(before, velocity=np.ones((2, 3)))
    loop.act(action, velocity=np.full((2, 3), 2.0))
    sample = sample_step(loop, simulation, np.full(2, 2))
    np.testing.assert_array_equal(sample.action, action)
    np.testing.assert_array_equal(sample.previous_action, before)
    np.testing.assert_array_equal(sample.command, np.ones((2, 3)))
    assert np.asarray(sample.frame).tolist() == [2, 2]
    assert sample.body_position.shape == (2, len(scenario.sim_config.bodies), 3)
    assert sample.base is None
