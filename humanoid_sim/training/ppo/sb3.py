"""PPO of stable-baselines3."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from stable_baselines3.common.vec_env import VecEnv, unwrap_vec_normalize
from torch import Tensor, nn

from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv
from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.learner import EndedError, Learner, PPOSettings
from humanoid_sim.training.ppo.network import Float32Array, Network, as_array, linear_layers


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


class StableBaselinesActor:
    """See `Actor`: an `MlpPolicy` of PPO or A2C, with the normalisation of this module, `VecNormalize`'s, or none."""

    def __init__(self, model: Any, envs: Any = None) -> None:
        """See `actor_of`.

        Raises:
            InputError: its policy is of another kind.
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
        self._model, self._policy = model, policy
        around = [venv for venv in (model.get_env(), envs) if isinstance(venv, VecEnv)]
        normalisers = [unwrap_vec_normalize(venv) for venv in around]
        self._normalised = next((one for one in normalisers if one is not None and one.norm_obs), None)

    def network(self) -> Network:
        """See `Actor.network`."""
        policy, space = self._policy, self._policy.action_space
        return Network(
            **self._normalisation(),
            **linear_layers([*policy.mlp_extractor.policy_net, policy.action_net]),
            bounds=(space.low.copy(), space.high.copy()),
        )

    def _normalisation(self) -> dict[str, Any]:
        own, around = self._policy.pi_features_extractor, self._normalised
        if isinstance(own, NormalisedObservation):
            if around is not None:
                raise InputError("model: VecNormalize and NormalisedObservation both normalise, expected one of them")
            return {"mean": as_array(own.mean), "deviation": as_array(own.deviation)}
        if around is None:
            width = own.features_dim
            return {"mean": np.zeros(width, dtype=np.float32), "deviation": np.ones(width, dtype=np.float32)}
        seen: Any = around.obs_rms
        return {
            "mean": seen.mean.astype(np.float32),
            "deviation": np.sqrt(seen.var + around.epsilon).astype(np.float32),
            "largest": float(around.clip_obs),
        }

    def answer(self, observations: Float32Array) -> Float32Array:
        """See `Actor.answer`."""
        seen = observations if self._normalised is None else self._normalised.normalize_obs(observations)
        actions: Float32Array = self._model.predict(seen, deterministic=True)[0]
        return actions


class StableBaselinesLearner(Learner):
    """See `Learner`."""

    SUFFIX = ".zip"

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], settings: PPOSettings, spread: float, seed: int, start: Path | None
    ) -> None:
        """See `Learner`."""
        self.envs = StableBaselinesVecEnv(envs)
        self.envs.seed(seed)
        batch = settings.steps_per_update * envs.num_envs
        arguments: dict[str, Any] = {
            "n_steps": settings.steps_per_update,
            "batch_size": max(batch // settings.minibatches, 2),
            "n_epochs": settings.epochs,
            "learning_rate": settings.learning_rate,
            "gamma": settings.gamma,
            "gae_lambda": settings.gae_lambda,
            "clip_range": settings.clip,
            "ent_coef": settings.entropy,
            "vf_coef": settings.value,
            "max_grad_norm": settings.largest_gradient,
            "target_kl": 2.0 * settings.desired_kl,
        }
        torch.manual_seed(seed)
        if start is not None:
            self.model = _PPO.load(start, env=self.envs, device="cpu", **arguments)
        else:
            policy = {
                "features_extractor_class": NormalisedObservation,
                "features_extractor_kwargs": {"least_deviation": settings.least_deviation},
                "net_arch": list(settings.widths),
                "activation_fn": nn.ELU,
                "log_std_init": float(np.log(spread)),
            }
            self.model = _PPO("MlpPolicy", self.envs, device="cpu", policy_kwargs=policy, **arguments)
        self.actor = StableBaselinesActor(self.model)
        self.steps = int(self.model.num_timesteps)

    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """See `Learner.learn`."""
        self.model.after_update = after_update
        with contextlib.suppress(EndedError):
            self.model.learn(steps - self.steps, reset_num_timesteps=False)
        self.steps = int(self.model.num_timesteps)

    def save(self, file: IO[bytes]) -> None:
        """See `Learner.save`."""
        self.model.save(file)


class _PPO(PPO):
    """Calls `after_update`, and updates the normalisation, after each update."""

    after_update: Callable[[Update], bool] | None = None

    def train(self) -> None:
        """One update."""
        super().train()
        seen = torch.as_tensor(self.rollout_buffer.observations)
        self.policy.features_extractor.learn(seen.reshape(-1, seen.shape[-1]))
        values = self.logger.name_to_value.items()
        losses = {name.removeprefix("train/"): float(value) for name, value in values if name.startswith("train/")}
        spread = float(self.policy.log_std.detach().exp().mean())
        if self.after_update is not None and not self.after_update(Update(self.num_timesteps, spread, losses)):
            raise EndedError

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "after_update"]
