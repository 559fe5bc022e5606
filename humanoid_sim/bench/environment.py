"""A step of the environment against the bare physics that it contains."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import mujoco
import numpy as np

from humanoid_sim.bench.timing import Row, paired_ratio
from humanoid_sim.envs.policy_env import PolicyEnv

__all__ = ["environment_step"]

_STEPS = 100
"""Policy steps that are timed together, out of the motion's first."""


def environment_step(repetitions: int) -> list[Row]:
    """`LiteTracking-v0.step` over the `mj_step`s in it: the sample policy's actions, and the same trajectory bare."""
    env = gymnasium.make("humanoid_sim/LiteTracking-v0")
    single = env.unwrapped
    assert isinstance(single, PolicyEnv)
    robot = single.robot
    actions, controls = _episode(env, single)
    model = copy.copy(robot.model)  # now, while the gains are in it: a reset takes them out
    data = mujoco.MjData(model)

    def begin() -> None:
        env.reset(seed=0)
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = robot.data.qpos, robot.data.qvel

    def steps() -> None:
        for action in actions:
            env.step(action)

    def bare() -> None:
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data, robot.physics_steps)

    def describe(ours: float, physics: float) -> str:
        return f"{1e6 * ours / _STEPS:.0f} µs per step, {1e6 * physics / _STEPS:.0f} µs bare"

    begin()
    steps()
    bare()
    if not np.array_equal(data.qpos, robot.data.qpos):
        raise AssertionError("the bare physics is not that of the environment")
    try:
        return [paired_ratio("LiteTracking-v0.step", steps, bare, repetitions, 1.4, describe, prepare=begin)]
    finally:
        env.close()


def _episode(env: gymnasium.Env[Any, Any], single: PolicyEnv) -> tuple[list[Any], list[Any]]:
    """The actions of the sample policy, and what the actuators are told in each step."""
    observation, info = env.reset(seed=0)
    actions, controls = [], []
    for _ in range(_STEPS):
        action = np.asarray(single.setting.policy(observation, info["frame"]), dtype=np.float32)
        observation, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            raise AssertionError("the episode ended before the last of its steps")
        actions.append(action)
        controls.append(single.robot.data.ctrl.copy())
    return actions, controls
