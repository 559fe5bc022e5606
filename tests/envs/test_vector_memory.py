"""Long runs of the vector environment."""

import gc
import os
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import humanoid_sim  # noqa: F401 - registers the environments

_STATM = Path("/proc/self/statm")


def resident_megabytes():
    gc.collect()
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.skipif(not _STATM.exists(), reason="needs Linux's /proc")
def test_many_vector_steps_hold_their_memory(request):
    """Episodes that end, actions that are refused, late commands and noise included; 100,000 steps with --complete."""
    count = 100_000 if request.config.getoption("--complete") else 25_000
    envs = gymnasium.make_vec(
        "humanoid_sim/LiteTracking-v0",
        num_envs=2,
        threads=2,
        max_episode_steps=50,
        randomisation={"mass": (0.9, 1.1), "command_delay": (0.0, 0.02), "joint_position_noise": 0.01},
    )
    envs.reset(seed=0)
    generator = np.random.default_rng(0)
    episodes, faults, early = 0, 0, 0.0
    for step in range(count):
        action = generator.uniform(-0.3, 0.3, (2, 14)).astype(np.float32)
        if step % 97 == 0:
            action[step % 2] = np.nan
        *_, terminated, truncated, info = envs.step(action)
        episodes += int((terminated | truncated).sum())
        faults += "fault" in info
        if step == 10_000:
            early = resident_megabytes()
    assert episodes > 0.03 * count
    assert faults > 0.005 * count
    assert resident_megabytes() < early + 2.0
    envs.close()
