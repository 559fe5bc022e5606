"""The hub's entry, called as LeRobot 0.4.4 calls it; with LeRobot itself in tests/lerobot/test_lerobot_hub.py."""

import importlib.util
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.envs.lerobot import hub_entry
from humanoid_sim.policy.checkpoint import load_checkpoint

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "lerobot_hub" / "env.py"


def example():
    spec = importlib.util.spec_from_file_location("hub_env", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_is_what_the_hub_calls():
    suites = example().make_env(n_envs=2, use_async_envs=False)
    assert list(suites) == ["humanoid_sim/LiteTracking-v0"]
    (envs,) = suites["humanoid_sim/LiteTracking-v0"].values()
    assert isinstance(envs, gymnasium.vector.SyncVectorEnv)
    observation, info = envs.reset(seed=[3, 4])
    assert observation["agent_pos"].shape == (2, 78)
    assert observation["agent_pos"].dtype == np.float32
    assert info["is_success"].tolist() == [False, False]
    assert envs.call("_max_episode_steps") == (400, 400)
    assert envs.call("task_description") == ("Wave with both arms.", "Wave with both arms.")
    assert envs.envs[0].task == "tracking"
    assert envs.unwrapped.metadata["render_fps"] == 50
    plain = gymnasium.make("humanoid_sim/LiteTracking-v0", motion="wave")
    np.testing.assert_array_equal(observation["agent_pos"][1], plain.reset(seed=4)[0])
    envs.close()
    plain.close()


def test_success_is_an_episode_to_its_end():
    (envs,) = hub_entry("humanoid_sim/LiteTracking-v0", "hold", motion="reach")(n_envs=2)[
        "humanoid_sim/LiteTracking-v0"
    ].values()
    policy = load_checkpoint(SAMPLE_POLICY).policy
    observation, _ = envs.reset(seed=[0, 1])
    succeeded = [False, False]
    for step in range(envs.call("_max_episode_steps")[0]):
        actions = np.stack([policy(row, step) for row in observation["agent_pos"]])
        if step == 5:
            actions[1] = np.nan
        observation, _, terminated, truncated, info = envs.step(actions)
        over = terminated | truncated
        assert ("final_info" in info) == bool(over.any())
        for i in np.flatnonzero(over):
            succeeded[i] |= bool(info["final_info"]["is_success"][i])
        if step == 5:
            assert over.tolist() == [False, True]
            assert "nan" in str(info["final_info"]["fault"][1]).lower()
            assert succeeded == [False, False]
    assert succeeded[0]
    envs.close()


@pytest.mark.filterwarnings(
    "ignore:.*is different from the unwrapped version",
    "ignore:.*symmetric and normalized",
    "ignore:.*Box observation space m",
)
def test_gymnasium_finds_nothing_wrong_with_one():
    (envs,) = example().make_env()["humanoid_sim/LiteTracking-v0"].values()
    check_env(envs.envs[0], skip_render_check=True)
    envs.close()
