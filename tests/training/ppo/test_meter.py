import gymnasium
import numpy as np
import pytest

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.training.ppo.journal import EpisodeMeter


def test_returns_and_lengths_are_those_of_the_episodes():
    meter = EpisodeMeter(
        gymnasium.make_vec(
            "humanoid_sim/LiteTracking-v0", num_envs=3, threads=1, autoreset_mode="SameStep", max_episode_steps=4
        )
    )
    meter.reset(seed=0)
    assert np.isnan(meter.means()).all()
    rewards = []
    for step in range(5):
        action = np.zeros((3, 14), dtype=np.float32)
        if step == 1:
            action[2] = np.nan  # a fault ends the third episode with its second step, without a reward
        _, reward, terminated, truncated, info = meter.step(action)
        rewards.append(reward)
        assert (terminated | truncated).tolist() == {1: [False, False, True], 3: [True, True, False]}.get(
            step, [False] * 3
        )
    expected = np.array([*np.sum(rewards[:4], axis=0)[:2], rewards[0][2]])
    assert meter.means() == pytest.approx((expected.mean(), (4 + 4 + 2) / 3, 1 / 3))
    assert set(meter.terms()) >= {"body_position", "action_rate"}
    assert meter.terms()["body_position"] == pytest.approx(float(info["terms"]["body_position"].mean()))
    meter.close()


def test_a_resumed_training_waits_for_its_long_episodes():
    name = "humanoid_sim/LiteTracking-v0"
    envs = gymnasium.make_vec(name, num_envs=2, threads=1, autoreset_mode="SameStep", max_episode_steps=4)
    meter = EpisodeMeter(envs, resumed=True)
    meter.reset(seed=0)
    action = np.zeros((2, 14), dtype=np.float32)
    meter.step(np.array([action[0], np.full(14, np.nan, dtype=np.float32)]))  # the second robot fails at once
    assert np.isnan(meter.means()).all()
    for _ in range(3):
        meter.step(action)
    assert meter.means()[1:] == (2.5, 0.5)
    meter.close()
