"""The closed loop: a restart touches nobody else."""

import numpy as np
import pytest

from humanoid_sim.envs.config import CONFIGS, build_scenario
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.simulation.batch_sim import BatchSim

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
