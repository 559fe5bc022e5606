"""The native vector environment against the bare physics that it contains, and against Gymnasium's own."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from humanoid_sim.bench.bare_rollout import BareRollout
from humanoid_sim.bench.timing import Row, paired_ratio
from humanoid_sim.controllers.action import action_command
from humanoid_sim.envs.vector_env import PolicyVectorEnv

__all__ = ["vector_step"]

_NAME = "humanoid_sim/LiteTracking-v0"
_MANY = 1024
_SOME = 64
"""Environments that Gymnasium's own steps one by one; how many makes no difference to the ratio."""
_STEPS = 2
"""Vector steps that are timed together."""
_SPREAD = 0.1
"""Of the actions, as a share of the action space."""


def vector_step(repetitions: int) -> list[Row]:
    """Vector steps over bare `mujoco.rollout`s of the same states and controls, and over `SyncVectorEnv`."""
    return [_over_rollout(repetitions), _over_sync(repetitions)]


def _over_rollout(repetitions: int) -> Row:
    envs = _Stepped("vector_entry_point", _MANY)
    native = envs.envs.unwrapped
    assert isinstance(native, PolicyVectorEnv)
    simulation = native.simulation
    envs.step()
    reached = simulation.qpos.copy()
    envs.begin()
    targets = [action_command(native.setting.side.action_map, action).position for action in envs.actions]
    physics = BareRollout(simulation, simulation.qpos, simulation.qvel, targets)
    physics.run()
    if not np.allclose(physics.qpos, reached, rtol=0.0, atol=1e-9):
        raise AssertionError("the bare physics is not that of the environments")

    def describe(ours: float, bare: float) -> str:
        count = _MANY * _STEPS
        return f"{count / ours:.0f} environment steps per s, {count / bare:.0f} bare, {simulation.threads} threads"

    name = f"vector, {_MANY} environments, over bare rollout"
    try:
        return paired_ratio(name, envs.step, physics.run, repetitions, 0.85, describe, speed=True, prepare=envs.begin)
    finally:
        physics.close()
        envs.envs.close()


def _over_sync(repetitions: int) -> Row:
    native, sync = _Stepped("vector_entry_point", _SOME), _Stepped("sync", _SOME)

    def begin() -> None:
        native.begin()
        sync.begin()

    def describe(ours: float, theirs: float) -> str:
        count = _SOME * _STEPS
        return f"{count / ours:.0f} environment steps per s, {count / theirs:.0f} one by one"

    name = "vector, over SyncVectorEnv"
    try:
        return paired_ratio(name, native.step, sync.step, repetitions, 1.9, describe, speed=True, prepare=begin)
    finally:
        native.envs.close()
        sync.envs.close()


class _Stepped:
    """Environments that are given the same actions from the same starts again and again."""

    def __init__(self, mode: str, count: int) -> None:
        self.envs: Any = gymnasium.make_vec(_NAME, num_envs=count, vectorization_mode=mode)
        self.envs.action_space.seed(0)
        self.actions = [np.float32(_SPREAD) * self.envs.action_space.sample() for _ in range(_STEPS)]
        self.begin()

    def begin(self) -> None:
        self.envs.reset(seed=0)

    def step(self) -> None:
        for action in self.actions:
            *_, terminated, truncated, _ = self.envs.step(action)
            if terminated.any() or truncated.any():  # the next step would do less than a step
                raise AssertionError("an episode ended before the last of the steps")
