"""The policy's environments as `dm_env` environments: `load("lite_tracking")`. Needs the extra `dm`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import needing
from humanoid_sim.mit import Float32Array
from humanoid_sim.rendering.pictures import choose_opengl

with needing("dm-env", "dm", "humanoid_sim.envs.dm"):
    import dm_env
    from dm_env import specs

if TYPE_CHECKING:
    from dm_control.mujoco import Physics


class DmEnv(dm_env.Environment):
    """`PolicyEnv` with the same episodes; `seed` is of the first. Discount 0: it failed; 1: motion or time was over."""

    def __init__(self, env: PolicyEnv, seed: int | None = None) -> None:
        self.env, self._seed, self._is_over = env, seed, True

    def reset(self) -> dm_env.TimeStep:
        observation, _ = self.env.reset(seed=self._seed)
        self._seed, self._is_over = None, False
        return dm_env.restart(observation)

    def step(self, action: Float32Array) -> dm_env.TimeStep:
        if self._is_over:
            return self.reset()
        observation, reward, terminated, truncated, _ = self.env.step(action)
        self._is_over = terminated or truncated
        if terminated:
            return dm_env.termination(reward, observation)
        return dm_env.truncation(reward, observation) if truncated else dm_env.transition(reward, observation)

    def observation_spec(self) -> specs.Array:
        return specs.Array(self.env.observation_space.shape, np.float32, "observation")

    def action_spec(self) -> specs.BoundedArray:
        space: Any = self.env.action_space
        return specs.BoundedArray(space.shape, np.float32, space.low, space.high, "action")

    @property
    def physics(self) -> Physics:
        """Return the simulation, for `dm_control.viewer`; physics and robot share their data."""
        if not hasattr(self, "_physics"):
            # dm_control loads an OpenGL when it is imported, by itself one that may not be there
            opengl = choose_opengl()
            os.environ.setdefault("MUJOCO_GL", opengl or "disable")
            from dm_control.mujoco import Physics, wrapper  # noqa: PLC0415

            self._physics = Physics(wrapper.MjData(self.env.robot.data))
        return self._physics

    def close(self) -> None:
        self.env.close()


def load(config: Any, *, seed: int | None = None, **options: Any) -> DmEnv:
    """Return an environment by the name of its configuration in `CONFIGS`, or by a `PolicyEnvConfig`."""
    return DmEnv(PolicyEnv(config, **options), seed)
