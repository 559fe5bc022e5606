"""The vector environment with robots and policies from outside, step by step beside a single one, and in long runs."""

import gc
import os
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from published import POLICIES, needs_policies

from humanoid_sim.robots.description import load_robot

NAME = "humanoid_sim/Policy-v0"
COUNT = 2


@needs_policies
@pytest.mark.soak
@pytest.mark.parametrize(
    ("policy", "timestep"),
    [("beyondmimic_g1/Waltz.onnx", 0.0025), ("unitree_g1_velocity_v0/exported/policy.onnx", 0.005)],
)
def test_a_published_policy_walks_the_same_steps(policy, timestep):
    options = {
        "contract": POLICIES / policy,
        "robot": load_robot(POLICIES / "models" / "unitree_g1" / "scene.xml"),
        "physics_timestep": timestep,
    }
    native = gymnasium.make_vec(NAME, num_envs=COUNT, threads=2, **options)
    singles = [gymnasium.make(NAME, **options) for _ in range(COUNT)]
    act = singles[0].unwrapped.scenario.policy
    native.reset(seed=0)
    seen = [single.reset(seed=i) for i, single in enumerate(singles)]
    for _ in range(50):
        actions = np.array([act(observation, info["frame"]) for observation, info in seen], dtype=np.float32)
        observations, rewards, terminated, _, info = native.step(actions)
        for i, single in enumerate(singles):
            observation, reward, over, _, its = single.step(actions[i])
            seen[i] = observation, its
            np.testing.assert_allclose(observations[i], observation, rtol=1e-5, atol=1e-5)
            assert rewards[i] == pytest.approx(reward, abs=1e-9)
            assert terminated[i] == over
            assert info["frame"][i] == its["frame"]
            np.testing.assert_allclose(native.simulation.qpos[i], single.unwrapped.robot.qpos, rtol=0, atol=1e-9)
        assert not terminated.any()


_STATM = Path("/proc/self/statm")


def resident_megabytes():
    gc.collect()
    return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.soak
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
