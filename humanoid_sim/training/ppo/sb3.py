"""PPO of stable-baselines3."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.network import Network
from humanoid_sim.training.ppo.settings import PPOSettings

__all__ = ["NormalisedObservation", "StableBaselinesLearner"]


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
        """What observations are divided by."""
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


class StableBaselinesLearner:
    """See `Learner`."""

    SUFFIX = ".zip"

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], settings: PPOSettings, spread: float, seed: int, start: Path | None
    ) -> None:
        """See `Learner`."""
        self._envs = StableBaselinesVecEnv(envs)
        self._envs.seed(seed)
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
            self._model = _PPO.load(start, env=self._envs, device="cpu", **arguments)
            return
        policy = {
            "features_extractor_class": NormalisedObservation,
            "features_extractor_kwargs": {"least_deviation": settings.least_deviation},
            "net_arch": list(settings.widths),
            "activation_fn": nn.ELU,
            "log_std_init": float(np.log(spread)),
        }
        self._model = _PPO("MlpPolicy", self._envs, device="cpu", policy_kwargs=policy, **arguments)

    @property
    def steps(self) -> int:
        """See `Learner.steps`."""
        return int(self._model.num_timesteps)

    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """See `Learner.learn`."""
        self._model.after_update = after_update
        with contextlib.suppress(_EndedError):
            self._model.learn(steps - self.steps, reset_num_timesteps=False)

    def save(self, path: Path) -> None:
        """See `Learner.save`."""
        self._model.save(path)

    def network(self) -> Network:
        """See `Learner.network`."""
        policy: Any = self._model.policy
        layers = [layer for layer in policy.mlp_extractor.policy_net if isinstance(layer, nn.Linear)]
        normaliser, space = policy.features_extractor, self._envs.action_space
        return Network(
            mean=normaliser.mean.numpy().copy(),
            deviation=normaliser.deviation.numpy().copy(),
            layers=tuple(
                (layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy())
                for layer in [*layers, policy.action_net]
            ),
            bounds=(space.low.copy(), space.high.copy()),
        )

    def answer(self, observations: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
        """See `Learner.answer`."""
        return self._model.predict(observations, deterministic=True)[0]

    def close(self) -> None:
        """See `Learner.close`."""
        self._envs.close()


class _EndedError(Exception):
    """The run is to end after this update."""


class _PPO(PPO):
    """Tells after each update, and lets the normalisation learn from what the update has used."""

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
            raise _EndedError

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "after_update"]
