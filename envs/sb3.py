"""The vector environment as stable-baselines3 wants it."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

from humanoid_sim.envs.vector_env import require_same_step
from humanoid_sim.errors import needing
from humanoid_sim.mit import BoolArray, Float32Array

with needing("stable-baselines3", "rl", "humanoid_sim.envs.sb3"):
    from stable_baselines3.common.vec_env import VecEnv


class Sb3VecEnv(VecEnv):
    """A vector environment with `autoreset_mode="SameStep"`. Its environments are one, so attributes are shared."""

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        self._whole = require_same_step(envs, "stable-baselines3")
        self.envs, self._actions = envs, np.zeros(0, dtype=np.float32)
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Float32Array:
        seeds = None if None in self._seeds else self._seeds
        observation, _ = self.envs.reset(seed=seeds, options=self._options[0] or None)
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observation)

    def step_async(self, actions: Float32Array) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Float32Array, Float32Array, BoolArray, list[dict[str, Any]]]:
        """Return observations, rewards, which episodes have ended, and an info of each environment."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        faults = info.get("final_info", {}).get("fault")
        for i in np.flatnonzero(terminated | truncated).tolist():
            infos[i] = {"terminal_observation": info["final_obs"][i], "TimeLimit.truncated": not terminated[i]}
            if faults is not None and faults[i]:
                infos[i]["fault"] = faults[i]
        return observation, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self._whole, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self._whole, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        return [getattr(self._whole, method_name)(*args, **kwargs)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        return [False] * self.num_envs
