"""PPO of rsl_rl."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from rsl_rl.models import MLPModel
from rsl_rl.modules.distribution import GaussianDistribution
from rsl_rl.runners import OnPolicyRunner
from torch import nn

from humanoid_sim.envs.rsl_rl import RslRlVecEnv
from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.learner import EndedError, Learner, PPOSettings
from humanoid_sim.training.ppo.network import Float32Array, Network, as_array, linear_layers


class RslRlActor:
    """See `Actor`: an `MLPModel` with a `GaussianDistribution`, that sees what the policy does."""

    def __init__(self, runner: Any) -> None:
        """See `actor_of`.

        Raises:
            InputError: it is not a runner, or its actor is of another kind.
        """
        algorithm = getattr(runner, "alg", None)
        if algorithm is None:
            raise InputError(f"model: is a {type(runner).__name__} of rsl_rl, expected a runner")
        actor: Any = algorithm.get_policy()
        if type(actor) is not MLPModel or type(actor.distribution) not in (GaussianDistribution, type(None)):
            found = f"a {type(actor).__name__} with {type(getattr(actor, 'distribution', None)).__name__}"
            raise InputError(f"model: its actor is {found}, expected an MLPModel with a GaussianDistribution")
        if list(actor.obs_groups) != ["policy"]:
            raise InputError(f"model: its actor sees the groups {', '.join(actor.obs_groups)}, expected policy")
        self._actor = actor

    def network(self) -> Network:
        """See `Actor.network`."""
        normaliser, width = self._actor.obs_normalizer, self._actor.obs_dim
        mean, deviation = np.zeros(width, dtype=np.float32), np.ones(width, dtype=np.float32)
        if not isinstance(normaliser, nn.Identity):
            mean, deviation = as_array(normaliser.mean), as_array(normaliser.std + normaliser.eps)
        return Network(mean=mean, deviation=deviation, **linear_layers(self._actor.mlp))

    def answer(self, observations: Float32Array) -> Float32Array:
        """See `Actor.answer`."""
        device = next(self._actor.parameters()).device
        with torch.no_grad():
            return as_array(self._actor({"policy": torch.from_numpy(observations).to(device)}))


class RslRlLearner(Learner):
    """See `Learner`."""

    SUFFIX = ".pt"

    def __init__(
        self, envs: VectorEnv[Any, Any, Any], settings: PPOSettings, spread: float, seed: int, start: Path | None
    ) -> None:
        """See `Learner`."""
        torch.manual_seed(seed)
        self.envs = RslRlVecEnv(envs, seed=seed)
        self._per_update = settings.steps_per_update * envs.num_envs
        network = {
            "class_name": "MLPModel",
            "hidden_dims": list(settings.widths),
            "activation": "elu",
            "obs_normalization": True,
        }
        critic = "critic" if "critic" in self.envs.get_observations() else "policy"
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
            self.model: Any = OnPolicyRunner(self.envs, configuration, log_dir=None)
        for model in (self.model.alg.actor, self.model.alg.critic):
            model.obs_normalizer.eps = settings.least_deviation
        self.steps = 0 if start is None else int(self.model.load(str(start))["steps"])
        self.actor = RslRlActor(self.model)

    def learn(self, steps: int, after_update: Callable[[Update], bool]) -> None:
        """See `Learner.learn`."""

        def log(*, loss_dict: dict[str, float], action_std: torch.Tensor, learning_rate: float, **_: Any) -> None:
            self.steps += self._per_update
            losses = {name: float(value) for name, value in loss_dict.items()} | {"learning_rate": learning_rate}
            if not after_update(Update(self.steps, float(action_std.detach().mean()), losses)):
                raise EndedError

        self.model.logger.log = log  # its own writes a page for each update, and only where it has a folder
        with contextlib.suppress(EndedError):
            self.model.learn(max(-(-(steps - self.steps) // self._per_update), 0))

    def save(self, file: IO[bytes]) -> None:
        """See `Learner.save`."""
        self.model.save(file, {"steps": self.steps})
