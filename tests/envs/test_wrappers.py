"""Gymnasium's own wrappers around single and vector environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.wrappers import vector

from humanoid_sim.robots.description import load_robot

NAME = "humanoid_sim/LiteTracking-v0"
ROBOT = load_robot("lite")
COUNT = 2


def single(**options):
    return gymnasium.make(NAME, robot=ROBOT, **options)


def several(**options):
    return gymnasium.make_vec(NAME, num_envs=COUNT, robot=ROBOT, threads=1, **options)


def rest(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


def test_record_episode_statistics():
    env = wrappers.RecordEpisodeStatistics(single(max_episode_steps=3))
    env.reset(seed=0)
    *rewards, (last, info) = [env.step(rest(env))[1::3] for _ in range(3)]
    total = sum(reward for reward, _ in rewards) + last
    assert info["episode"]["l"] == 3
    assert info["episode"]["r"] == pytest.approx(total)

    envs = vector.RecordEpisodeStatistics(several(max_episode_steps=3))
    envs.reset(seed=0)
    steps = [envs.step(rest(envs)) for _ in range(3)]
    assert "episode" not in steps[1][4]
    statistics = steps[2][4]["episode"]
    assert statistics["l"].tolist() == [3, 3]
    np.testing.assert_allclose(statistics["r"], sum(step[1] for step in steps))
    assert statistics["r"][0] == pytest.approx(total)  # the same seed


def test_normalize_observation():
    envs = vector.NormalizeObservation(several(max_episode_steps=8))
    observations, _ = envs.reset(seed=0)
    for _ in range(20):
        observations, *_ = envs.step(envs.action_space.sample() * np.float32(0.1))
    assert observations.shape == envs.observation_space.shape
    assert np.abs(observations).max() < 6.0
    # Gymnasium starts from a count of 1e-4, and counts each environment's observation of every step and reset.
    assert envs.obs_rms.count == pytest.approx(21 * COUNT, abs=1e-3)
