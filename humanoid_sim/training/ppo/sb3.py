"""PPO of stable-baselines3."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import IO, Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecNormalize, unwrap_vec_normalize
from torch import Tensor, nn

from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv
from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.learner import SETTINGS, Actor, Float32Array, Learner, reading, require_sound


class NormalisedObservation(BaseFeaturesExtractor):
    """Observations less their mean, over their standard deviation, both of all that was ever seen in training.

    They are buffers of the policy: saved with it, and exported with it.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, observation_space: gymnasium.spaces.Box, least_deviation: float) -> None:
        """Begin with mean 0 and deviation 1, to which `least_deviation` is added."""
        width = observation_space.shape[0]
        super().__init__(observation_space, width)
        self._least = least_deviation
        self.register_buffer("mean", torch.zeros(width))
        self.register_buffer("variance", torch.ones(width))
        self.register_buffer("count", torch.zeros(()))

    @property
    def deviation(self) -> Tensor:
        """Return what observations are divided by."""
        return self.variance.sqrt() + self._least

    def forward(self, observations: Tensor) -> Tensor:
        """Normalise."""
        return (observations - self.mean) / self.deviation

    def learn(self, observations: Tensor) -> None:
        """Take more observations (k, N) into account."""
        variance, mean = torch.var_mean(observations, dim=0, unbiased=False)
        self.count += len(observations)
        rate, away = len(observations) / self.count, mean - self.mean
        self.mean += rate * away
        self.variance += rate * (variance - self.variance + away * (mean - self.mean))


class _Clip(nn.Module):
    """Clips to bounds, which are numbers or tensors."""

    def __init__(self, low: Any, high: Any) -> None:
        super().__init__()
        self.register_buffer("low", torch.as_tensor(low))
        self.register_buffer("high", torch.as_tensor(high))

    def forward(self, values: Tensor) -> Tensor:
        return torch.minimum(torch.maximum(values, self.low), self.high)


def actor_of(model: Any, envs: Any = None) -> Actor:
    """Return the actor of PPO or A2C with an `MlpPolicy`, normalised by this module, by `VecNormalize`, or not at all.

    Raises `InputError` if its policy is of another kind.
    """
    policy = getattr(model, "policy", None)
    kinds = (FlattenExtractor, NormalisedObservation)
    if (
        not isinstance(policy, ActorCriticPolicy)
        or policy.use_sde
        or not isinstance(policy.pi_features_extractor, kinds)
    ):
        found = f"a {type(model).__name__} with {type(policy).__name__}"
        raise InputError(f"model: is {found}, expected PPO or A2C with an MlpPolicy, without use_sde")
    around = [unwrap_vec_normalize(venv) for venv in (model.get_env(), envs) if isinstance(venv, VecEnv)]
    normalised = next((one for one in around if one is not None and one.norm_obs), None)
    own, bounds = policy.pi_features_extractor, policy.action_space
    before = [own]
    if normalised is not None:
        if isinstance(own, NormalisedObservation):
            raise InputError("model: VecNormalize and NormalisedObservation both normalise, expected one of them")
        before = [_as_module(normalised), _Clip(-normalised.clip_obs, normalised.clip_obs)]

    def answer(observations: Float32Array) -> Float32Array:
        seen = observations if normalised is None else normalised.normalize_obs(observations)
        actions: Float32Array = model.predict(seen, deterministic=True)[0]
        return actions

    last = policy.mlp_extractor.policy_net, policy.action_net, _Clip(bounds.low.copy(), bounds.high.copy())
    widths = policy.observation_space.shape[0], bounds.shape[0]
    return Actor(nn.Sequential(*before, *last).to(policy.device), widths, answer)


def _as_module(normalised: VecNormalize) -> NormalisedObservation:
    statistics: Any = normalised.obs_rms
    module = NormalisedObservation(normalised.observation_space, 0.0)
    module.mean.copy_(torch.as_tensor(statistics.mean))
    module.variance.copy_(torch.as_tensor(statistics.var + normalised.epsilon))
    return module


class StableBaselinesLearner(Learner):
    """See `Learner`."""

    SUFFIX = ".zip"

    def __init__(self, envs: VectorEnv[Any, Any, Any], spread: float, seed: int, start: Path | None) -> None:
        """See `Learner`."""
        set_random_seed(seed % 2**32)  # NumPy's too, which draws the minibatches
        self.envs = StableBaselinesVecEnv(envs)
        self.envs.seed(seed)
        self._per_update = SETTINGS.steps_per_update * envs.num_envs
        policy = {
            "features_extractor_class": NormalisedObservation,
            "features_extractor_kwargs": {"least_deviation": SETTINGS.least_deviation},
            "net_arch": list(SETTINGS.widths),
            "activation_fn": nn.ELU,
            "log_std_init": float(np.log(spread)),
        }
        self.model = PPO(
            "MlpPolicy",
            self.envs,
            device="cpu",
            policy_kwargs=policy,
            n_steps=SETTINGS.steps_per_update,
            batch_size=max(self._per_update // SETTINGS.minibatches, 2),
            n_epochs=SETTINGS.epochs,
            learning_rate=SETTINGS.learning_rate,
            gamma=SETTINGS.gamma,
            gae_lambda=SETTINGS.gae_lambda,
            clip_range=SETTINGS.clip,
            ent_coef=SETTINGS.entropy,
            vf_coef=SETTINGS.value,
            max_grad_norm=SETTINGS.largest_gradient,
            target_kl=2.0 * SETTINGS.desired_kl,
        )
        self.model.set_logger(Logger(folder=None, output_formats=[]))
        self.answer = actor_of(self.model).answer
        if start is not None:  # `PPO.load` would unpickle, and so run, what the file says
            with reading(start), zipfile.ZipFile(start) as archive:
                self.model.set_parameters(str(start), device="cpu")
                self.model.num_timesteps = int(json.loads(archive.read("data"))["num_timesteps"])
                require_sound(self.model.policy.optimizer, self.model.policy)
        self.steps = self.model.num_timesteps

    def update(self) -> Update:
        """See `Learner.update`."""
        self.model.learn(self._per_update, reset_num_timesteps=False)
        self.steps = self.model.num_timesteps
        seen = torch.as_tensor(self.model.rollout_buffer.observations)
        self.model.policy.features_extractor.learn(seen.reshape(-1, seen.shape[-1]))
        values = self.model.logger.name_to_value.items()
        losses = {name.removeprefix("train/"): float(value) for name, value in values if name.startswith("train/")}
        return Update(self.steps, float(self.model.policy.log_std.detach().exp().mean()), losses)

    def save(self, file: IO[bytes]) -> None:
        """See `Learner.save`."""
        self.model.save(file)
