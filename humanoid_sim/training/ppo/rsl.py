"""PPO of rsl_rl."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from rsl_rl.runners import OnPolicyRunner
from torch import nn

from humanoid_sim.envs.rsl_rl import RslRlVecEnv
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.network import Network
from humanoid_sim.training.ppo.settings import PPOSettings

__all__ = ["RslRlLearner"]


class _EndedError(Exception):
    """The run is to end after this update."""


class _Reporter:
    """In the place of rsl_rl's own logger, which prints a page for each update and copies the repository's state."""

    writer = None
    """None keeps the runner from writing checkpoints itself."""

    def __init__(self, report: Callable[[float, dict[str, float]], bool]) -> None:
        self._report = report

    def init_logging_writer(self) -> None:
        """Nothing to begin."""

    def process_env_step(self, *_: Any) -> None:
        """Episodes are counted by `EpisodeMeter`."""

    def save_model(self, path: str, iteration: int) -> None:
        """Nothing to upload."""

    def log(self, *, loss_dict: dict[str, float], action_std: torch.Tensor, learning_rate: float, **_: Any) -> None:
        """After an update."""
        losses = {**{name: float(value) for name, value in loss_dict.items()}, "learning_rate": float(learning_rate)}
        if not self._report(float(action_std.detach().mean()), losses):
            raise _EndedError


class RslRlLearner:
    """See `Learner`."""

    SUFFIX = ".pt"

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], settings: PPOSettings, spread: float, seed: int, start: Path | None
    ) -> None:
        """See `Learner`."""
        torch.manual_seed(seed)
        self._envs = RslRlVecEnv(envs, seed=seed)
        self._per_update = settings.steps_per_update * envs.num_envs
        network = {
            "class_name": "MLPModel",
            "hidden_dims": list(settings.widths),
            "activation": "elu",
            "obs_normalization": True,
        }
        critic = "critic" if "critic" in self._envs.get_observations() else "policy"
        configuration = {
            "num_steps_per_env": settings.steps_per_update,
            "save_interval": 1,
            "obs_groups": {"actor": ["policy"], "critic": [critic]},
            "actor": {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": spread}},
            "critic": network,
            "algorithm": {
                "class_name": "PPO",
                "num_learning_epochs": settings.epochs,
                "num_mini_batches": settings.minibatches,
                "learning_rate": settings.learning_rate,
                "gamma": settings.gamma,
                "lam": settings.gae_lambda,
                "clip_param": settings.clip,
                "entropy_coef": settings.entropy,
                "value_loss_coef": settings.value,
                "max_grad_norm": settings.largest_gradient,
                "desired_kl": settings.desired_kl,
            },
        }
        with contextlib.redirect_stdout(io.StringIO()):  # it prints its networks
            self._runner = OnPolicyRunner(self._envs, configuration, log_dir=None)
        for model in (self._runner.alg.actor, self._runner.alg.critic):
            model.obs_normalizer.eps = settings.least_deviation
        self.steps = 0
        if start is not None:
            self.steps = int(self._runner.load(str(start))["steps"])

    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """See `Learner.learn`."""

        def report(spread: float, losses: dict[str, float]) -> bool:
            self.steps += self._per_update
            return after_update(Update(self.steps, spread, losses))

        self._runner.logger = _Reporter(report)
        with contextlib.suppress(_EndedError):
            self._runner.learn(max(-(-(steps - self.steps) // self._per_update), 0))

    def save(self, path: Path) -> None:
        """See `Learner.save`."""
        self._runner.save(str(path), {"steps": self.steps})

    def network(self) -> Network:
        """See `Learner.network`."""
        actor: Any = self._runner.alg.get_policy()
        normaliser = actor.obs_normalizer
        return Network(
            mean=normaliser.mean.numpy().copy(),
            deviation=(normaliser.std + normaliser.eps).numpy().copy(),
            layers=tuple(
                (layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy())
                for layer in actor.mlp
                if isinstance(layer, nn.Linear)
            ),
        )

    def answer(self, observations: np.ndarray[Any, np.dtype[np.float32]]) -> Any:
        """See `Learner.answer`."""
        with torch.no_grad():
            return self._runner.alg.get_policy()({"policy": torch.from_numpy(observations)}).numpy()

    def close(self) -> None:
        """See `Learner.close`."""
        self._envs.close()
