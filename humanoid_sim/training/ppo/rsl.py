"""PPO of rsl_rl."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import IO, Any

import torch
from gymnasium.vector import VectorEnv
from rsl_rl.models import MLPModel
from rsl_rl.runners import OnPolicyRunner

from humanoid_sim.envs.rsl_rl import RslRlVecEnv
from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.journal import Update
from humanoid_sim.training.ppo.learner import SETTINGS, Actor, Float32Array, Learner, reading, require_sound


def actor_of(runner: Any) -> Actor:
    """Return the actor of a runner with an `MLPModel` that sees what the policy does.

    Raises `InputError` if it is not a runner, or its actor is of another kind.
    """
    algorithm = getattr(runner, "alg", None)
    if algorithm is None:
        raise InputError(f"model: is a {type(runner).__name__} of rsl_rl, expected a runner")
    actor: Any = algorithm.get_policy()
    if type(actor) is not MLPModel:
        raise InputError(f"model: its actor is a {type(actor).__name__}, expected an MLPModel")
    if list(actor.obs_groups) != ["policy"]:
        raise InputError(f"model: its actor sees the groups {', '.join(actor.obs_groups)}, expected policy")
    device = next(actor.parameters()).device

    def answer(observations: Float32Array) -> Float32Array:
        with torch.no_grad():
            actions: Float32Array = actor({"policy": torch.from_numpy(observations).to(device)}).cpu().numpy()
        return actions

    return Actor(actor.as_onnx(verbose=False), (actor.obs_dim, runner.env.num_actions), answer)


class RslRlLearner(Learner):
    """See `Learner`."""

    SUFFIX = ".pt"

    def __init__(self, envs: VectorEnv[Any, Any, Any], spread: float, seed: int, start: Path | None) -> None:
        """See `Learner`."""
        torch.manual_seed(seed)
        self.envs = RslRlVecEnv(envs, seed=seed)
        self._per_update = SETTINGS.steps_per_update * envs.num_envs
        network = {
            "class_name": "MLPModel",
            "hidden_dims": list(SETTINGS.widths),
            "activation": "elu",
            "obs_normalization": True,
        }
        critic = "critic" if "critic" in self.envs.get_observations() else "policy"
        configuration = {
            "num_steps_per_env": SETTINGS.steps_per_update,
            "save_interval": 1,
            "obs_groups": {"actor": ["policy"], "critic": [critic]},
            "actor": {**network, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": spread}},
            "critic": network,
            "algorithm": {
                "class_name": "PPO",
                "num_learning_epochs": SETTINGS.epochs,
                "num_mini_batches": SETTINGS.minibatches,
                "learning_rate": SETTINGS.learning_rate,
                "gamma": SETTINGS.gamma,
                "lam": SETTINGS.gae_lambda,
                "clip_param": SETTINGS.clip,
                "entropy_coef": SETTINGS.entropy,
                "value_loss_coef": SETTINGS.value,
                "max_grad_norm": SETTINGS.largest_gradient,
                "desired_kl": SETTINGS.desired_kl,
            },
        }
        with contextlib.redirect_stdout(io.StringIO()):  # it prints its networks
            self.model: Any = OnPolicyRunner(self.envs, configuration, log_dir=None)
        for model in (self.model.alg.actor, self.model.alg.critic):
            model.obs_normalizer.eps = SETTINGS.least_deviation
        self.model.logger.log = self._note  # its own writes a page for each update, and only where it has a folder
        self.answer = actor_of(self.model).answer
        self.steps = 0
        if start is not None:  # `load` would unpickle, and so run, what the file says
            with reading(start):
                known = torch.load(start, weights_only=True)
                self.model.alg.load(known, None, strict=True)
                self.steps = int(known["infos"]["steps"])
                require_sound(self.model.alg.optimizer, self.model.alg.actor, self.model.alg.critic)

    def update(self) -> Update:
        """See `Learner.update`."""
        self.model.learn(1)
        self.steps += self._per_update
        return Update(self.steps, self._spread, self._losses)

    def _note(self, *, loss_dict: dict[str, float], action_std: torch.Tensor, learning_rate: float, **_: Any) -> None:
        self._spread = float(action_std.detach().mean())
        self._losses = {name: float(value) for name, value in loss_dict.items()} | {"learning_rate": learning_rate}

    def save(self, file: IO[bytes]) -> None:
        """See `Learner.save`."""
        self.model.save(file, {"steps": self.steps})
