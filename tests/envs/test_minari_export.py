"""A Minari dataset holds what happened, and is read back by Minari itself."""

import gymnasium
import numpy as np
import pytest

import humanoid_sim  # noqa: F401 - registers the environments
from humanoid_sim.errors import InputError

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")

from humanoid_sim.envs.minari_export import export_rollouts  # noqa: E402 - not without the library

NAME = "humanoid_sim/LiteTracking-v0"


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


@pytest.mark.filterwarnings("ignore")  # of Minari: that there is no author, no address of code
def test_a_dataset_holds_the_episodes_and_makes_the_environment_again():
    env = gymnasium.make(NAME, contract="lite_tracking", episode_seconds=1.0, task="balance")
    told = []
    export_rollouts(env, "lite/balance-v0", episodes=2, seed=7, on_episode=lambda *done: told.append(done))
    dataset = minari.load_dataset("lite/balance-v0")
    again = dataset.recover_environment()
    for i, episode in enumerate(dataset.iterate_episodes()):
        observation, info = again.reset(seed=7 + i)
        total = 0.0
        for step in range(50):
            np.testing.assert_array_equal(episode.observations[step], observation)
            action = again.unwrapped.scenario.policy(observation, info["frame"])
            np.testing.assert_array_equal(episode.actions[step], action)
            observation, reward, terminated, truncated, info = again.step(action)
            assert episode.rewards[step] == pytest.approx(reward)
            assert episode.infos["effort"][step] == pytest.approx(float(info["terms"]["effort"]))
            assert (episode.terminations[step], episode.truncations[step]) == (terminated, truncated)
            total += reward
        assert truncated
        assert told[i] == (i + 1, pytest.approx(total))
    assert (dataset.total_episodes, dataset.total_steps) == (2, 100)
    with pytest.raises(InputError, match="dataset_id: there is a local dataset 'lite/balance-v0' already"):
        export_rollouts(env, "lite/balance-v0", episodes=1)
    again.close()
    env.close()


@pytest.mark.filterwarnings("ignore")
def test_an_episode_that_a_fault_ends_is_kept():
    env = gymnasium.make(NAME)
    export_rollouts(env, "fault-v0", episodes=1, policy=lambda _: np.full(14, 1e4))
    (episode,) = minari.load_dataset("fault-v0").iterate_episodes()
    assert (episode.terminations.tolist(), episode.rewards.tolist()) == ([True], [0.0])
    env.close()


def test_what_cannot_be_exported_is_said():
    modes = gymnasium.make("humanoid_sim/LiteModes-v0")
    with pytest.raises(InputError, match="env: is a ModesEnv, expected a policy's environment"):
        export_rollouts(modes, "modes-v0", episodes=1)
    modes.close()
    env = gymnasium.make(NAME)
    with pytest.raises(InputError, match="episodes: is 0, expected at least 1"):
        export_rollouts(env, "none-v0", episodes=0)
    env.close()
