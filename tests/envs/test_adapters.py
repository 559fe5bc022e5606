"""Other libraries' interfaces to the same episodes, and their checkers."""

import importlib
import importlib.util
import sys
import unittest
from types import ModuleType

import gymnasium
import numpy as np
import pytest
from alike import LITE
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from humanoid_sim.assets import WALKING_POLICY
from humanoid_sim.envs import ENVIRONMENTS
from humanoid_sim.envs.config import PolicyEnvConfig, build_scenario
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.trace import record_trace
from humanoid_sim.errors import InputError
from humanoid_sim.policy_tools.stamp import stamp

with_dm = pytest.mark.skipif(sys.version_info >= (3, 13), reason="dm-control needs labmaze, without a wheel for 3.13")


def vector(mode="SameStep", **options):
    return gymnasium.make_vec(LITE, num_envs=2, threads=1, autoreset_mode=mode, **options)


@with_dm
def test_dm_env_has_the_same_episodes_and_its_own_checks_pass():
    test_utils = importlib.import_module("dm_env.test_utils")
    dm = importlib.import_module("humanoid_sim.envs.dm")
    ours, theirs = (
        dm.DmEnv("lite_tracking", seed=3, max_episode_steps=3),
        PolicyEnv("lite_tracking", max_episode_steps=3),
    )
    np.testing.assert_array_equal(ours.reset().observation, theirs.reset(seed=3)[0])
    generator = np.random.default_rng(0)
    for _ in range(3):
        action = generator.uniform(-0.1, 0.1, 14).astype(np.float32)
        step, (observation, reward, _, truncated, _) = ours.step(action), theirs.step(action)
        np.testing.assert_array_equal(step.observation, observation)
        assert (step.reward, step.last()) == (reward, truncated)
    assert step.discount == 1.0
    assert ours.step(action).first()
    failed = ours.step(np.full(14, np.nan))
    assert (failed.last(), failed.reward, failed.discount) == (True, 0.0, 0.0)

    class Checks(test_utils.EnvironmentTestMixin, unittest.TestCase):
        def make_object_under_test(self):
            return dm.DmEnv("lite_tracking", seed=0, max_episode_steps=5)

        def make_action_sequence(self):
            return [np.full(14, 0.01 * i, dtype=np.float32) for i in range(20)]

    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(Checks).run(result)
    assert result.testsRun > 3
    assert [*result.errors, *result.failures] == []


@with_dm
def test_dm_control_s_viewer_runs_it(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    dm = importlib.import_module("humanoid_sim.envs.dm")
    # The loop needs no OpenGL, but is only to be had with its window, which does.
    monkeypatch.setitem(sys.modules, "dm_control.viewer.gui", ModuleType("gui"))
    module = importlib.import_module("dm_control.viewer.runtime")
    runtime = module.Runtime(dm.DmEnv("lite_tracking", seed=0), lambda _: np.zeros(14, dtype=np.float32))
    errors = []
    runtime.on_error += errors.append
    for _ in range(5):
        runtime.tick(0.02, paused=False)
    assert errors == []
    assert runtime.get_time() == pytest.approx(0.1, abs=0.03)
    runtime.stop()


@pytest.mark.peers
def test_rsl_rl_gets_tensors():
    torch = importlib.import_module("torch")
    module = importlib.import_module("humanoid_sim.envs.rsl_rl")
    envs = module.RslRlVecEnv(RecordEpisodeStatistics(vector(max_episode_steps=3)), seed=3)
    np.testing.assert_array_equal(envs.get_observations()["policy"].numpy(), vector().reset(seed=3)[0])
    assert (envs.num_envs, envs.num_actions, envs.max_episode_length) == (2, 14, 3)
    envs.episode_length_buf = torch.tensor([1, 0])
    for k in range(2):
        observations, rewards, over, extras = envs.step(torch.zeros(2, 14))
        assert over.tolist() == extras["time_outs"].tolist() == [k == 1, False]
    assert observations["policy"].shape == (2, 78)
    assert rewards.dtype == torch.float32
    assert extras["log"]["/reward/body_position"] > 0.0
    with pytest.raises(InputError, match="autoreset_mode: is 'NextStep', expected 'SameStep' for rsl_rl"):
        module.RslRlVecEnv(vector("NextStep"))


@pytest.mark.peers
def test_stable_baselines3_gets_infos():
    module = importlib.import_module("humanoid_sim.envs.sb3")
    envs = module.Sb3VecEnv(vector(max_episode_steps=2))
    envs.seed(3)
    np.testing.assert_array_equal(envs.reset(), vector().reset(seed=3)[0])
    actions = np.zeros((2, 14), dtype=np.float32)
    envs.step(actions)
    actions[1] = np.nan
    observation, reward, over, infos = envs.step(actions)
    assert over.tolist() == [True, True]
    assert [info["TimeLimit.truncated"] for info in infos] == [True, False]
    assert "nan" in infos[1]["fault"]
    assert infos[0]["terminal_observation"].shape == observation[0].shape
    assert reward.dtype == np.float32
    assert envs.get_attr("max_episode_steps") == [2, 2]
    with pytest.raises(InputError, match="expected 'SameStep' for stable-baselines3"):
        module.Sb3VecEnv(vector("NextStep"))


def test_a_checkpoint_is_stamped_with_a_run_of_its_environment(tmp_path):
    scenario = build_scenario(PolicyEnvConfig(policy=WALKING_POLICY, robot="lite_biped"))
    trace, output = tmp_path / "trace.npz", tmp_path / "stamped.onnx"
    policy = scenario.policy
    assert record_trace(scenario, lambda observation: policy(observation[0], 0)[None], trace, steps=20) == 20
    samples = stamp(WALKING_POLICY, output, description=scenario.description, trace=trace)
    assert abs(samples.arrays["observation"][:, 6:9]).max() > 0.1, "it walks: a zero command would show no scale"


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized", "ignore:.*Box observation space m")
def test_gymnasium_finds_nothing_wrong(name):
    env = gymnasium.make(name)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.peers
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_stable_baselines3_finds_nothing_wrong(name):
    checker = importlib.import_module("stable_baselines3.common.env_checker")
    env = gymnasium.make(name)
    checker.check_env(env.unwrapped, warn=False, skip_render_check=True)
    env.close()
