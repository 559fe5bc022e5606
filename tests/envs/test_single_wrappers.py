"""Gymnasium's own wrappers around the single environments."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, RecordEpisodeStatistics, TimeLimit


@pytest.mark.parametrize("name", ["LiteTracking-v0", "BipedVelocity-v0"])
def test_normalised_observations_and_statistics(name: str) -> None:
    env = gymnasium.make(f"humanoid_sim/{name}")
    wrapped = RecordEpisodeStatistics(NormalizeObservation(TimeLimit(env, 30)))
    rng, total = np.random.default_rng(0), 0.0
    for seed in (0, None):
        wrapped.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, info = wrapped.step(rng.normal(0.0, 0.1, 14))
            total, over = total + float(reward), terminated or truncated
            assert observation.shape == env.observation_space.shape
            assert np.abs(observation).max() < 30.0
    assert info["episode"]["l"] == 30
    assert info["episode"]["r"] == pytest.approx(total, abs=1e-6)
