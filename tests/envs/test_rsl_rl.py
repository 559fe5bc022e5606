"""rsl_rl on the native vector environment."""

from importlib import import_module

import gymnasium
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot

torch = pytest.importorskip("torch")
pytest.importorskip("rsl_rl")

NAME = "humanoid_sim/LiteTracking-v0"
ROBOT = load_robot("lite")

pytestmark = pytest.mark.peers


def adapter(envs, **options):
    """Imports TensorDict, which takes seconds, only where these tests run."""
    return import_module("humanoid_sim.envs.rsl_rl").RslRlVecEnv(envs, **options)


def adapted(count, seed=None, **options):
    options = {"autoreset_mode": "SameStep", "robot": ROBOT, "threads": 1, **options}
    return adapter(gymnasium.make_vec(NAME, num_envs=count, **options), seed=seed)


def test_steps_are_those_of_the_vector_environment():
    ours = adapted(2, seed=4, max_episode_steps=2)
    plain = gymnasium.make_vec(NAME, num_envs=2, robot=ROBOT, threads=1, autoreset_mode="SameStep", max_episode_steps=2)
    np.testing.assert_array_equal(ours.get_observations()["policy"].numpy(), plain.reset(seed=4)[0])
    for step in range(4):
        action = np.zeros((2, 14), dtype=np.float32)
        if step == 2:
            action[1] = np.nan
        observations, rewards, dones, extras = ours.step(torch.from_numpy(action))
        expected = plain.step(action)
        np.testing.assert_array_equal(observations["policy"].numpy(), expected[0])
        np.testing.assert_allclose(rewards.numpy(), expected[1], rtol=1e-6)
        assert dones.tolist() == (expected[2] | expected[3]).tolist()
        assert extras["time_outs"].tolist() == (expected[3] & ~expected[2]).tolist()
        assert extras["log"]["/reward/body_position"] > 0.0
        assert ours.episode_length_buf.tolist() == plain.unwrapped.episode_steps.tolist()
    assert (ours.max_episode_length, ours.num_actions, ours.device) == (2, 14, "cpu")
    ours.close()
    plain.close()


def test_episodes_of_a_set_length_can_be_put_out_of_step():
    ours = adapted(3, seed=0, task="balance", episode_seconds=0.1)
    ours.episode_length_buf = torch.tensor([4, 0, 2])
    ended = [ours.step(torch.zeros(3, 14))[2].tolist() for _ in range(5)]
    assert [row.index(True) if True in row else None for row in ended] == [0, None, 2, None, 1]
    with pytest.raises(InputError, match=r"episode_steps: has shape \(2,\), expected \(3,\) numbers >= 0"):
        ours.episode_length_buf = torch.tensor([1, 2])
    ours.close()


def test_ppo_learns_on_it(tmp_path):
    """Holding the arms up costs effort; in 12 288 steps the policy finds that they may hang lower."""
    from rsl_rl.runners import OnPolicyRunner  # noqa: PLC0415 - not without it

    torch.set_num_threads(1)
    torch.manual_seed(0)
    count, steps = 64, 32
    envs = adapted(
        count,
        seed=0,
        threads=2,
        max_episode_steps=steps,
        task="balance",
        weights={"effort": -3.0, "alive": 0.0},
    )
    network = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "tanh"}
    noise = {"class_name": "GaussianDistribution", "init_std": 0.37}
    runner = OnPolicyRunner(
        envs,
        {
            "num_steps_per_env": steps,
            "save_interval": 100,
            "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
            "actor": {**network, "distribution_cfg": noise},
            "critic": network,
            "algorithm": {"class_name": "PPO", "learning_rate": 1e-3, "gamma": 0.95, "num_mini_batches": 8},
        },
        log_dir=str(tmp_path),
    )
    rewards = []
    step = envs.step
    envs.step = lambda actions: (result := step(actions), rewards.append(float(result[1].mean())))[0]
    runner.learn(6)
    runner.logger.writer.close()
    episodes = np.array(rewards).reshape(6, steps).mean(axis=1)
    assert episodes[0] < 0.0
    assert episodes[-1] > 0.95 * episodes[0]
    assert (tmp_path / "model_5.pt").exists()
    envs.close()
