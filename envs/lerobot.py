"""The entry for LeRobot's environment hub: the `make_env` of a repository's `env.py`. Needs no LeRobot itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv

from humanoid_sim.envs.registration import register_environments
from humanoid_sim.envs.resets import count_option
from humanoid_sim.mit import Float32Array

Observation = dict[str, Float32Array]
MakeEnv = Callable[..., Mapping[str, Mapping[int, VectorEnv[Any, Any, Any]]]]


class EvaluatedEnv(gymnasium.Wrapper[Any, Any, Any, Any], gymnasium.utils.RecordConstructorArgs):
    """A policy's environment as LeRobot 0.4 evaluates and records policies in it.

    What the policy observes is `agent_pos`, which LeRobot turns into `observation.state`. `info["is_success"]` is true
    with the last step of an episode in which the robot did not fail: it followed the motion to its end, or stayed up.
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
        told = {"is_success": bool(truncated and not terminated)}
        if "fault" in info:
            told["fault"] = info["fault"]
        return {"agent_pos": observation}, float(reward), terminated, truncated, told


def hub_entry(name: str, task: str = "", **options: Any) -> MakeEnv:
    """Return the `make_env` that LeRobot calls.

    Args:
        name: of a policy's environment, such as `humanoid_sim/LiteTracking-v0`: the name of the suite as well.
        task: what is to be done, in words, for policies that read it.

    Returns:
        `make_env(n_envs=1, use_async_envs=False, cfg=None)`, which gives `{name: {0: vector environment}}`.
    """
    make = partial(_evaluated, name, task, options)

    def make_env(
        n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None
    ) -> Mapping[str, Mapping[int, VectorEnv[Any, Any, Any]]]:
        """Episodes start in the step that ends the last ones, as LeRobot expects; `cfg` is not looked at."""
        del cfg
        functions = [make] * count_option("n_envs", n_envs)
        kind = AsyncVectorEnv if use_async_envs else SyncVectorEnv
        envs: VectorEnv[Any, Any, Any] = kind(functions, autoreset_mode=AutoresetMode.SAME_STEP)
        return {name: {0: envs}}

    return make_env


def _evaluated(name: str, task: str, options: Mapping[str, Any]) -> EvaluatedEnv:
    register_environments()  # in a worker process nobody has
    return EvaluatedEnv(gymnasium.make(name, **{"render_mode": "rgb_array", **options}), task)
