"""Gymnasium's own wrappers around the single environments."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, RecordEpisodeStatistics, RecordVideo, TimeLimit


def test_record_video(tmp_path: Path) -> None:
    env = gymnasium.make("humanoid_sim/LiteTracking-v0", render_mode="rgb_array", width=64, height=64)
    recorded = RecordVideo(
        TimeLimit(env, 5), str(tmp_path / "videos"), episode_trigger=lambda _: True, disable_logger=True
    )
    recorded.reset(seed=0)
    for step in range(1, 6):
        *_, truncated, _ = recorded.step(np.zeros(14, dtype=np.float32))
        assert truncated is (step == 5)
    recorded.close()
    (video,) = (tmp_path / "videos").glob("*.mp4")
    assert video.stat().st_size > 500


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
