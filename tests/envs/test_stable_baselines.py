"""stable-baselines3 on the native vector environment."""

import gymnasium
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot

pytest.importorskip("torch")
stable_baselines3 = pytest.importorskip("stable_baselines3")

from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv  # noqa: E402 - not without the library

NAME = "humanoid_sim/LiteTracking-v0"
ROBOT = load_robot("lite")

pytestmark = pytest.mark.peers


def adapted(count, **options):
    options = {"autoreset_mode": "SameStep", "robot": ROBOT, "threads": 1, **options}
    return StableBaselinesVecEnv(gymnasium.make_vec(NAME, num_envs=count, **options))


def test_steps_are_those_of_the_vector_environment():
    ours = adapted(2, max_episode_steps=2)
    plain = gymnasium.make_vec(NAME, num_envs=2, robot=ROBOT, threads=1, autoreset_mode="SameStep", max_episode_steps=2)
    assert ours.seed(4) == [4, 5]
    np.testing.assert_array_equal(ours.reset(), plain.reset(seed=4)[0])
    for step in range(4):
        action = np.zeros((2, 14), dtype=np.float32)
        if step == 2:
            action[1] = np.nan
        observation, reward, done, infos = ours.step(action)
        expected = plain.step(action)
        np.testing.assert_array_equal(observation, expected[0])
        np.testing.assert_allclose(reward, expected[1], rtol=1e-6)
        np.testing.assert_array_equal(done, expected[2] | expected[3])
        for i in np.flatnonzero(done):
            np.testing.assert_array_equal(infos[i]["terminal_observation"], expected[4]["final_obs"][i])
        assert [info.get("TimeLimit.truncated") for info in infos] == {
            0: [None, None],
            1: [True, True],
            2: [None, False],
            3: [True, None],
        }[step]
        assert ("fault" in infos[1]) == (step == 2)
    ours.close()
    plain.close()


def test_ppo_learns_on_it():
    """Holding the arms up costs effort; in 12 288 steps the policy finds that they may hang lower."""
    import torch  # noqa: PLC0415 - not without it

    torch.set_num_threads(1)
    count, steps = 64, 32
    envs = adapted(count, threads=2, max_episode_steps=steps, task="balance", weights={"effort": -3.0, "alive": 0.0})
    model = stable_baselines3.PPO(
        "MlpPolicy",
        envs,
        n_steps=steps,
        batch_size=256,
        learning_rate=1e-3,
        gamma=0.95,
        seed=0,
        device="cpu",
        policy_kwargs={"log_std_init": -1.0, "net_arch": [64, 64]},
    )
    rewards = []

    def record(local, _):
        rewards.append(float(np.mean(local["rewards"])))
        return True

    model.learn(6 * count * steps, callback=record)
    assert model.num_timesteps == 12_288
    episodes = np.array(rewards).reshape(6, steps).mean(axis=1)
    assert episodes[0] < 0.0
    assert episodes[-1] > 0.95 * episodes[0]
    action, _ = model.predict(envs.reset(), deterministic=True)
    assert action.shape == (count, 14)
    envs.close()
