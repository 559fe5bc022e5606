"""The entry for LeRobot's environment hub: the `make_env` of a repository's `env.py`. Needs no LeRobot itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv

from humanoid_sim.envs.registration import register_environments
from humanoid_sim.mit import Float32Array

Observation = dict[str, Float32Array]


class EvaluatedEnv(gymnasium.Wrapper[Any, Any, Any, Any], gymnasium.utils.RecordConstructorArgs):
    """A policy's environment as LeRobot 0.4 evaluates policies in it, and records them.

    The observation is `agent_pos`. `info["is_success"]` is true with the last step of an episode without a failure.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], task: str) -> None:
        """Wrap `env`; `task` says in words what is to be done."""
        gymnasium.utils.RecordConstructorArgs.__init__(self, task=task)
        gymnasium.Wrapper.__init__(self, env)
        whole: Any = env.unwrapped
        self.observation_space = gymnasium.spaces.Dict({"agent_pos": env.observation_space})
        self.task, self.task_description = whole.scenario.contract.task_type, task
        self._max_episode_steps = int(whole.max_episode_steps)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, Any]:
        """See `gymnasium.Env.reset`."""
        observation, _ = self.env.reset(seed=seed, options=options)
        return {"agent_pos": observation}, {"is_success": False}

    def step(self, action: Float32Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """See `gymnasium.Env.step`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        shown = {"is_success": bool(truncated and not terminated)} | {k: info[k] for k in ("fault",) if k in info}
        return {"agent_pos": observation}, float(reward), terminated, truncated, shown


def hub_entry(name: str, task: str = "", **options: Any) -> Callable[..., Mapping[str, Mapping[int, Any]]]:
    """Return the `make_env` that LeRobot calls, for the environment of that id; `task`: what is to be done, in words.

    `make_env(n_envs=1, use_async_envs=False, cfg=None)` gives `{name: {0: vector environment}}`.
    """
    make = partial(_evaluated, name, task, options)

    def make_env(n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None) -> Mapping[str, Mapping[int, Any]]:
        del cfg  # as LeRobot's own environments have it
        kind = AsyncVectorEnv if use_async_envs else SyncVectorEnv
        return {name: {0: kind([make] * n_envs, autoreset_mode=AutoresetMode.SAME_STEP)}}

    return make_env


def _evaluated(name: str, task: str, options: Mapping[str, Any]) -> EvaluatedEnv:
    register_environments()  # a worker process has not
    return EvaluatedEnv(gymnasium.make(name, **{"render_mode": "rgb_array", **options}), task)
