"""The policy's environments as `dm_env` environments: `DmEnv("lite_tracking")`. Needs the extra `dm`."""

from __future__ import annotations

import os
from functools import cached_property
from typing import Any

import numpy as np

from humanoid_sim.envs.config import PolicyEnvConfig
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import needing
from humanoid_sim.mit import Float32Array
from humanoid_sim.rendering.pictures import choose_opengl

with needing("dm-env", "dm", "humanoid_sim.envs.dm"):
    import dm_env
    from dm_env import specs


class DmEnv(dm_env.Environment):
    """`PolicyEnv` with the same episodes; `seed` is of the first. Discount 0: it failed; 1: motion or time was over."""

    def __init__(self, config: PolicyEnvConfig | str, *, seed: int | None = None, **options: Any) -> None:
        self.env, self._seed, self._is_over = PolicyEnv(config, **options), seed, True

    def reset(self) -> dm_env.TimeStep:
        observation, _ = self.env.reset(seed=self._seed)
        self._seed, self._is_over = None, False
        return dm_env.restart(observation)

    def step(self, action: Float32Array) -> dm_env.TimeStep:
        if self._is_over:
            return self.reset()
        observation, reward, terminated, truncated, _ = self.env.step(action)
        self._is_over = terminated or truncated
        ending = dm_env.termination if terminated else dm_env.truncation
        return ending(reward, observation) if self._is_over else dm_env.transition(reward, observation)

    def observation_spec(self) -> specs.Array:
        return specs.Array(self.env.observation_space.shape, np.float32, "observation")

    def action_spec(self) -> specs.BoundedArray:
        space: Any = self.env.action_space
        return specs.BoundedArray(space.shape, np.float32, space.low, space.high, "action")

    @cached_property
    def physics(self) -> Any:
        """Return the simulation, a `Physics`, for `dm_control.viewer`; physics and robot share their data."""
        # dm_control loads an OpenGL when it is imported, by itself one that may not be there
        os.environ.setdefault("MUJOCO_GL", choose_opengl() or "disable")
        from dm_control.mujoco import Physics, wrapper  # noqa: PLC0415

        return Physics(wrapper.MjData(self.env.robot.data))

    def close(self) -> None:
        self.env.close()
