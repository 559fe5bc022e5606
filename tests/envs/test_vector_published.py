"""Robots and policies from outside in the vector environment, step by step beside a single one."""

import gymnasium
import numpy as np
import pytest
from published import POLICIES, needs_policies

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.robots.description import load_robot

NAME = "humanoid_sim/Policy-v0"
COUNT = 2


@needs_policies
@pytest.mark.slow
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
