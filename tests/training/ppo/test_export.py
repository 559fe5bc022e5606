"""From a training loop of one's own to a file that plays, with each library; and what no file can hold."""

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers.vector import ClipAction, RecordEpisodeStatistics

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.training import export_policy

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("rsl_rl")

import torch
from rsl_rl.runners import OnPolicyRunner
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from humanoid_sim.envs.rsl_rl import RslRlVecEnv
from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv
from humanoid_sim.training.ppo.sb3 import NormalisedObservation

LEGS = {"id": "humanoid_sim/BipedVelocity-v0"}
ARMS = {"id": "humanoid_sim/LiteTracking-v0", "motion": "reach"}


def made(subject, **options):
    torch.set_num_threads(1)
    return gymnasium.make_vec(
        **subject, num_envs=4, threads=1, actuation="implicit", autoreset_mode="SameStep", **options
    )


@pytest.fixture(scope="module")
def arms():
    envs = StableBaselinesVecEnv(RecordEpisodeStatistics(made(ARMS)))
    yield envs
    envs.close()


def check(path, scenario, answers):
    """The file answers what the library does, and its golden vectors are a trainer's."""
    checkpoint = load_checkpoint(path)  # which verifies them
    assert "trainer" in checkpoint.golden
    assert checkpoint.contract.joint_names == scenario.contract.joint_names
    names = [[term.name for term in contract.observation] for contract in (checkpoint.contract, scenario.contract)]
    assert names[0] == names[1]
    seen = np.random.default_rng(1).normal(size=(8, checkpoint.observation_width)).astype(np.float32)
    actions = np.array([checkpoint.policy(observation, 0) for observation in seen])
    np.testing.assert_allclose(actions, answers(seen), rtol=1e-4, atol=1e-4)
    assert np.abs(actions).max() > 1e-3


@pytest.mark.parametrize(
    ("activation", "normaliser"), [(torch.nn.Tanh, "none"), (torch.nn.ReLU, "own"), (torch.nn.SiLU, "VecNormalize")]
)
def test_a_loop_with_stable_baselines3(activation, normaliser, tmp_path):
    whole = made(LEGS)
    envs = VecMonitor(StableBaselinesVecEnv(whole))
    settings = {"activation_fn": activation, "net_arch": [8, 8], "log_std_init": -3.0}
    if normaliser == "VecNormalize":
        envs = VecNormalize(envs, clip_obs=1.5)
    if normaliser == "own":
        settings |= {
            "features_extractor_class": NormalisedObservation,
            "features_extractor_kwargs": {"least_deviation": 0.2},
        }
    model = PPO("MlpPolicy", envs, n_steps=8, batch_size=16, n_epochs=1, policy_kwargs=settings, seed=0, device="cpu")
    model.learn(64)
    if normaliser == "VecNormalize":
        assert abs(envs.obs_rms.mean).max() > 0.1
    output = export_policy(model, envs, tmp_path / "mine.onnx")
    assert output == tmp_path / "mine.onnx"

    def answers(seen):
        seen = envs.normalize_obs(seen) if normaliser == "VecNormalize" else seen
        return model.predict(seen, deterministic=True)[0]

    check(output, whole.unwrapped.scenario, answers)
    first = output.read_bytes()
    export_policy(model, whole, output)  # around it or without, and over the file that is there
    assert output.read_bytes() == first
    envs.close()


def runner(envs, **actor):
    network = {"class_name": "MLPModel", "hidden_dims": [8, 8], "activation": "elu", "obs_normalization": True}
    configuration = {
        "num_steps_per_env": 8,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 0.05}, **actor},
        "critic": network,
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 1, "num_mini_batches": 1},
    }
    return OnPolicyRunner(envs, configuration, log_dir=None)


@pytest.mark.parametrize(
    "settings",
    [
        {"distribution_cfg": {"class_name": "HeteroscedasticGaussianDistribution", "init_std": 0.05}},
        {"activation": "relu", "obs_normalization": False},
    ],
)
def test_a_loop_with_rsl_rl(settings, tmp_path):
    envs = RslRlVecEnv(made(LEGS, privileged=["base_linear_velocity"]), seed=0)
    model = runner(envs, **settings)
    model.learn(2)
    output = export_policy(model, envs, str(tmp_path / "mine.onnx"))
    policy = model.alg.get_policy()

    def answers(seen):
        with torch.no_grad():
            return policy({"policy": torch.from_numpy(seen)}).numpy()

    check(output, envs.envs.unwrapped.scenario, answers)
    envs.close()


def test_an_actor_that_sees_more_than_the_policy_is_refused(tmp_path):
    envs = RslRlVecEnv(made(LEGS, privileged=["base_linear_velocity"]), seed=0)
    model = runner(envs)
    model.alg.get_policy().obs_groups = ["policy", "critic"]
    with pytest.raises(InputError, match=r"^model: its actor sees the groups policy, critic, expected policy$"):
        export_policy(model, envs, tmp_path / "mine.onnx")
    with pytest.raises(InputError, match=r"^model: is a MLPModel of rsl_rl, expected a runner$"):
        export_policy(model.alg.get_policy(), envs, tmp_path / "mine.onnx")
    model.alg._raw_actor = torch.nn.Linear(2, 3)
    with pytest.raises(InputError, match=r"^model: its actor is a Linear, expected an MLPModel$"):
        export_policy(model, envs, tmp_path / "mine.onnx")
    assert list(tmp_path.iterdir()) == []
    envs.close()


def test_a_policy_that_follows_a_motion(arms, tmp_path):
    model = A2C("MlpPolicy", arms, n_steps=4, policy_kwargs={"log_std_init": -3.0}, seed=0, device="cpu")
    model.learn(16)
    output = export_policy(model, arms, tmp_path / "mine.onnx")
    check(output, arms.envs.unwrapped.scenario, lambda seen: model.predict(seen, deterministic=True)[0])


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (SAC, {}, "model: is a SAC with SACPolicy, expected PPO or A2C with an MlpPolicy, without use_sde"),
        (PPO, {"use_sde": True}, "model: is a PPO with ActorCriticPolicy, expected PPO or A2C with an MlpPolicy"),
    ],
)
def test_models_that_no_file_can_hold(arms, kind, settings, message, tmp_path):
    with pytest.raises(InputError, match=f"^{message}"):
        export_policy(kind("MlpPolicy", arms, device="cpu", **settings), arms, tmp_path / "mine.onnx")
    assert list(tmp_path.iterdir()) == []


def test_environments_and_files_that_do_not_fit_are_named(arms, tmp_path):
    output, model = tmp_path / "mine.onnx", PPO("MlpPolicy", arms, n_steps=4, batch_size=8, device="cpu")
    with pytest.raises(InputError, match=r"^output: is '.*mine\.pt', expected a name that ends in \.onnx$"):
        export_policy(model, arms, tmp_path / "mine.pt")
    with pytest.raises(InputError, match=r"^model: is a function, expected a model of stable-baselines3 or a runner"):
        export_policy(check, arms, output)
    with pytest.raises(InputError, match=r"^envs: is a NoneType, expected the environments that the policy learned"):
        export_policy(model, None, output)
    env = gymnasium.make(**ARMS)
    alone = gymnasium.wrappers.TransformObservation(env, lambda seen: seen, env.observation_space)
    for wrapped in (ClipAction(arms.envs), alone):
        name = type(wrapped).__name__
        with pytest.raises(InputError, match=f"^envs: {name} changes observations or actions, which the file would n"):
            export_policy(model, wrapped, output)
    alone.close()
    legs = PolicyEnv("lite_biped_velocity", "lite_biped")
    with pytest.raises(InputError, match=r"^model: takes 78 values and gives 14, expected 53 and 14 of these env"):
        export_policy(model, legs, output)
    legs.close()
    assert list(tmp_path.iterdir()) == []
