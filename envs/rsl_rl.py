"""The vector environment as rsl_rl (from version 4 on) wants it: tensors, on the CPU, and observations in groups."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from humanoid_sim.envs.vector_env import require_same_step
from humanoid_sim.errors import needing
from humanoid_sim.mit import Float32Array

with needing("rsl-rl-lib", "rl", "humanoid_sim.envs.rsl_rl"):
    import torch
    from rsl_rl.env import VecEnv
    from tensordict import TensorDict


class RslRlVecEnv(VecEnv):
    """A vector environment with `autoreset_mode="SameStep"`. Observations are the group `policy`."""

    def __init__(self, envs: VectorEnv[Any, Any, Any], *, seed: int | None = None) -> None:
        """Take over `envs`, and start an episode in each; environment i has `seed + i`."""
        self._whole = whole = require_same_step(envs, "rsl_rl")
        self.envs, self.num_envs, self.device = envs, envs.num_envs, "cpu"
        self.num_actions = envs.single_action_space.shape[0]  # type: ignore[index]
        self.max_episode_length = whole.max_episode_steps
        self.cfg = {"policy_dt": whole.scenario.contract.policy_dt, "robot": whole.scenario.description.name}
        self._observations = self._grouped(envs.reset(seed=seed)[0])

    @property
    def episode_length_buf(self) -> torch.Tensor:
        return torch.from_numpy(self._whole.episode_steps.copy())

    @episode_length_buf.setter
    def episode_length_buf(self, steps: torch.Tensor) -> None:
        self._whole.episode_steps = steps.cpu().numpy().astype(np.int64)

    def get_observations(self) -> TensorDict:
        return self._observations

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """Step with actions (N, m): observations, rewards (N,), ended episodes (N,), and extras.

        Extras are `time_outs`, (N,), and `log`, the mean of each reward term.
        """
        observation, reward, terminated, truncated, info = self.envs.step(actions.detach().cpu().numpy())
        self._observations = self._grouped(observation)
        terms = info.get("terms", {})  # of the environments that go on
        means = {f"/reward/{name}": float(terms[name][terms[f"_{name}"]].mean()) for name in terms if name[0] != "_"}
        extras = {"time_outs": torch.from_numpy(truncated & ~terminated), "log": means}
        rewards = torch.from_numpy(reward.astype(np.float32))
        return self._observations, rewards, torch.from_numpy(terminated | truncated), extras

    def close(self) -> None:
        self.envs.close()

    def _grouped(self, observation: Float32Array) -> TensorDict:
        return TensorDict({"policy": torch.from_numpy(observation)}, batch_size=[self.num_envs])
