"""The vector environment as rsl_rl wants it: tensors, and observations in groups."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from humanoid_sim.envs.resets import require_same_step, term_means
from humanoid_sim.errors import needing
from humanoid_sim.mit import Float32Array

with needing("rsl-rl-lib", "rl", "humanoid_sim.envs.rsl_rl"):
    import torch
    from rsl_rl.env import VecEnv
    from tensordict import TensorDict


class RslRlVecEnv(VecEnv):
    """A policy's vector environment for rsl_rl (from version 4 on).

    Observations are the group `policy`. Every number stays on the CPU.

    That library starts an episode in the step that ends the last one, so the environment must as well:
    `gymnasium.make_vec(..., autoreset_mode="SameStep")`.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], *, seed: int | None = None) -> None:
        """Take over `envs`, and start an episode in each; closing this closes them.

        Raises `InputError` if they start episodes another way.

        Args:
            envs: a policy's, from `gymnasium.make_vec`.
            seed: of environment 0; environment i has `seed + i`.
        """
        require_same_step(envs, "rsl_rl")
        self.envs = envs
        whole: Any = envs.unwrapped
        self.num_envs = envs.num_envs
        self.num_actions = envs.single_action_space.shape[0]  # type: ignore[index]
        self.max_episode_length = whole.max_episode_steps
        self.device = "cpu"
        self.cfg = {"policy_dt": whole.scenario.contract.policy_dt, "robot": whole.scenario.description.name}
        self._whole = whole
        observation, _ = envs.reset(seed=seed)
        self._observations = self._grouped(observation)

    @property
    def episode_length_buf(self) -> torch.Tensor:
        """Shape (N,), policy steps since each episode began. Setting it lets episodes of a set length end earlier."""
        return torch.from_numpy(self._whole.episode_steps.copy())

    @episode_length_buf.setter
    def episode_length_buf(self, steps: torch.Tensor) -> None:
        self._whole.episode_steps = steps.cpu().numpy()

    def get_observations(self) -> TensorDict:
        """Return the latest, shape (N, …) each."""
        return self._observations

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One policy step of every environment; `actions` is shape (N, m).

        Returns:
            Observations; rewards, shape (N,); which episodes have ended, shape (N,); and `time_outs`, those whose time
            was up, with `log`, the mean of each reward term in this step.
        """
        observation, reward, terminated, truncated, info = self.envs.step(actions.detach().cpu().numpy())
        self._observations = self._grouped(observation)
        extras = {
            "time_outs": torch.from_numpy(truncated & ~terminated),
            "log": {f"/reward/{name}": value for name, value in term_means(info).items()},
        }
        rewards = torch.from_numpy(reward.astype(np.float32))
        return self._observations, rewards, torch.from_numpy(terminated | truncated), extras

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def _grouped(self, observation: Float32Array) -> TensorDict:
        return TensorDict({"policy": torch.from_numpy(observation.copy())}, batch_size=[self.num_envs])
