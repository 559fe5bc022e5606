"""PPO of stable-baselines3 on the walking robots: a network that a critic with more to see teaches, stage by stage."""

from __future__ import annotations

import copy
import json
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.save_util import load_from_zip_file
from torch import Tensor, nn

from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_folder, whole_file
from humanoid_sim.strict_json import parse_json
from humanoid_sim.training.ppo.learner import reading, require_sound
from tools.samples.walking.gait import INPUTS
from tools.samples.walking.learning_env import PRIVILEGED, LearningEnv
from tools.samples.walking.stages import CONTRACT, RANDOMISATION, TIMESTEP, Stage

__all__ = ["WalkingPolicy", "learn", "network_weights"]

_WIDTHS = 192, 128
_FIRST_SPREAD = 0.37
"""Standard deviation of the actions of a new network."""
_SMALL = 0.01
"""By which a new network's answers are scaled: it begins with the gait alone."""
_SAVED_EVERY = 120.0
"""s of wall time between two checkpoints."""
_SHOWN_EVERY = 30.0
"""s of wall time between two lines of progress."""


class _TwoNetworks(nn.Module):
    """The actor sees its input, the critic what is privileged as well."""

    def __init__(self) -> None:
        super().__init__()
        self.policy_net = _perceptron(INPUTS)
        self.value_net = _perceptron(INPUTS + PRIVILEGED)
        self.latent_dim_pi = self.latent_dim_vf = _WIDTHS[-1]

    def forward(self, seen: Tensor) -> tuple[Tensor, Tensor]:
        return self.forward_actor(seen), self.forward_critic(seen)

    def forward_actor(self, seen: Tensor) -> Tensor:
        features: Tensor = self.policy_net(seen[:, :INPUTS])
        return features

    def forward_critic(self, seen: Tensor) -> Tensor:
        features: Tensor = self.value_net(seen)
        return features


def _perceptron(width: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for following in _WIDTHS:
        layers += [nn.Linear(width, following), nn.ELU()]
        width = following
    return nn.Sequential(*layers)


class WalkingPolicy(ActorCriticPolicy):
    """stable-baselines3's policy with `_TwoNetworks`."""

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = _TwoNetworks()


def network_weights(model: PPO) -> dict[str, npt.NDArray[np.float32]]:
    """Return the actor's linear layers as `export_walking` takes them."""
    policy: Any = model.policy
    layers = [layer for layer in policy.mlp_extractor.policy_net if isinstance(layer, nn.Linear)]
    weights = {}
    for i, layer in enumerate([*layers, policy.action_net]):
        weights[f"network.{i}.weight"] = layer.weight.detach().numpy().copy()
        weights[f"network.{i}.bias"] = layer.bias.detach().numpy().copy()
    return weights


def learn(stages: tuple[Stage, ...], folder: Path, seed: int, show: Callable[[str], None], *, resume: bool) -> PPO:
    """Run the stages one after the other; each goes on from the network of the one before.

    Raises `InputError` if the folder has a checkpoint and is not to be resumed, or a damaged one; it cannot be written,
    or another process writes it.

    Args:
        stages: to run.
        folder: for checkpoints, one at the end of each stage and one every two minutes; made if it is missing.
        seed: of everything random.
        show: takes lines of progress.
        resume: go on from the latest checkpoint in the folder, if there is one.
    """
    with exclusive_folder(folder, "--folder"):
        return _learn(stages, folder, seed, show, resume=resume)


def _learn(stages: tuple[Stage, ...], folder: Path, seed: int, show: Callable[[str], None], *, resume: bool) -> PPO:
    latest, place = folder / "latest.zip", folder / "latest.json"
    first, done = 0, 0
    if latest.is_file() and place.is_file():
        if not resume:
            raise InputError(f"--folder: '{folder}' has a checkpoint; --resume goes on from it, another folder begins")
        names = [stage.name for stage in stages]
        with reading(place):
            known = parse_json(place.read_bytes())
            name, done = str(known["stage"]), int(known["steps"])
        if name not in names:
            raise InputError(f"{place}: stage is '{name}', expected one of {', '.join(names)}")
        first = names.index(name)
        show(f"goes on in stage '{name}' after {done} steps")
    model: PPO | None = None
    for i, stage in enumerate(stages[first:], first):
        torch.manual_seed(seed + i)
        env = _environment(stage, seed + i)
        source = latest if latest.is_file() else None
        model = _model(stage, env, source, fresh_spread=done == 0)
        if done == 0 and stage.mean_of:
            _average(model, [folder / f"{name}.zip" for name in stage.mean_of])
        if stage.steps > done:
            progress = _Progress(stage, folder, done, show)
            model.learn(stage.steps - done, callback=progress, reset_num_timesteps=True)
            _save(model, folder, stage, stage.steps)
        with whole_file(folder / f"{stage.name}.zip") as file:
            model.save(file)
        env.close()
        done = 0
    assert model is not None
    return model


def _environment(stage: Stage, seed: int) -> LearningEnv:
    envs = PolicyVectorEnv(
        stage.robots,
        CONTRACT,
        "lite_biped",
        task="walking",
        actuation="implicit",
        physics_timestep=TIMESTEP,
        randomisation=RANDOMISATION,
        autoreset_mode="SameStep",
        weights=dict(stage.weights),
    )
    env = LearningEnv(envs, stage, seed)
    env.seed(100_000 * (seed + 1))
    return env


def _model(stage: Stage, env: LearningEnv, source: Path | None, *, fresh_spread: bool) -> PPO:
    settings: dict[str, Any] = {
        "n_steps": stage.steps_per_update,
        "batch_size": stage.batch,
        "n_epochs": stage.epochs,
        "learning_rate": stage.learning_rate,
        "gamma": 0.985,
        "gae_lambda": 0.95,
        "clip_range": 0.2,
        "ent_coef": stage.entropy,
        "vf_coef": 1.0,
        "max_grad_norm": 1.0,
        "target_kl": 0.03,
    }
    start = {"log_std_init": float(np.log(_FIRST_SPREAD)), "ortho_init": False}
    model = PPO(WalkingPolicy, env, device="cpu", policy_kwargs=start, **settings)
    if source is not None:  # `PPO.load` would unpickle, and so run, what the file says
        with reading(source):
            model.set_parameters(str(source), device="cpu")
            require_sound(model.policy.optimizer, model.policy)
        model.policy.optimizer.param_groups[0]["lr"] = stage.learning_rate
    else:
        with torch.no_grad():
            model.policy.action_net.weight.mul_(_SMALL)
            model.policy.action_net.bias.zero_()
    if stage.spread is not None and fresh_spread:
        with torch.no_grad():
            model.policy.log_std.fill_(float(np.log(stage.spread)))
    return model


def _average(model: PPO, checkpoints: list[Path]) -> None:
    """Give a model the mean of some others' networks; the spread of its actions stays."""
    own: dict[str, Tensor] = copy.deepcopy(model.policy.state_dict())  # else it would change with the model
    others: list[Any] = []
    for path in checkpoints:
        with reading(path):
            read: Any = load_from_zip_file(path, device="cpu", load_data=False)[1]["policy"]
            model.policy.load_state_dict(read)
            require_sound(model.policy.optimizer, model.policy)
            others.append(read)
    mean = {name: torch.stack([other[name] for other in others]).mean(dim=0) for name in own if name != "log_std"}
    model.policy.load_state_dict(own | mean)


def _save(model: PPO, folder: Path, stage: Stage, steps: int) -> None:
    """Write the checkpoint first, then where it stands: a run that ends between the two repeats a little."""
    with whole_file(folder / "latest.zip") as file:
        model.save(file)
    with whole_file(folder / "latest.json") as file:
        file.write(json.dumps({"stage": stage.name, "steps": steps, "settings": asdict(stage)}).encode())


class _Progress(BaseCallback):
    """Lines of progress, and checkpoints."""

    def __init__(self, stage: Stage, folder: Path, done: int, show: Callable[[str], None]) -> None:
        super().__init__()
        self._stage, self._folder, self._done, self._show = stage, folder, done, show
        self._begin = self._saved = self._shown = time.monotonic()
        self._reward = self._ticks = 0.0
        self._falls = 0

    def _on_step(self) -> bool:
        rewards, infos = self.locals["rewards"], self.locals["infos"]
        self._reward += float(np.mean(rewards))
        self._ticks += 1
        over = np.flatnonzero(self.locals["dones"])
        self._falls += sum(not infos[i]["TimeLimit.truncated"] for i in over)
        return True

    def _on_rollout_end(self) -> None:
        now = time.monotonic()
        steps = self._done + self.num_timesteps
        if now - self._shown > _SHOWN_EVERY:
            envs: Any = self.training_env
            minutes = self._ticks * envs.num_envs * 0.02 / 60.0
            spread = float(self.model.policy.log_std.exp().mean())
            self._show(
                f"{self._stage.name}: {steps / 1e6:.2f} of {self._stage.steps / 1e6:.2f} M steps, "
                f"{self.num_timesteps / (now - self._begin):.0f}/s, "
                f"reward {50.0 * self._reward / self._ticks:.2f} per s, "
                f"{self._falls / minutes:.2f} falls per minute, spread {spread:.3f}"
            )
            self._shown, self._reward, self._ticks, self._falls = now, 0.0, 0.0, 0
        if now - self._saved > _SAVED_EVERY:
            self._saved = now
            _save(self.model, self._folder, self._stage, steps)
