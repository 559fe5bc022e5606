"""The native vector environment against the bare physics that it contains, and against Gymnasium's own."""

from __future__ import annotations

from typing import Any

import gymnasium
import mujoco
import numpy as np
from mujoco import rollout

from humanoid_sim.bench.timing import Row, paired_ratio
from humanoid_sim.controllers.action import action_command
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.mit import FloatArray

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
    physics = _BareRollout(envs)

    def begin() -> None:
        envs.begin()
        physics.begin()

    def describe(ours: float, bare: float) -> str:
        count = _MANY * _STEPS
        return f"{count / ours:.0f} environment steps per s, {count / bare:.0f} bare, {physics.threads} threads"

    begin()
    envs.step()
    reached = physics.simulation.qpos.copy()
    begin()
    physics.step()
    if not np.allclose(physics.qpos, reached, rtol=0.0, atol=1e-9):
        raise AssertionError("the bare physics is not that of the environments")
    name = f"vector, {_MANY} environments, over bare rollout"
    try:
        return paired_ratio(name, envs.step, physics.step, repetitions, 0.85, describe, speed=True, prepare=begin)
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


class _BareRollout:
    """The physics of a vector environment alone: the same models, states, controls and threads."""

    def __init__(self, stepped: _Stepped) -> None:
        native: Any = stepped.envs.unwrapped
        assert isinstance(native, PolicyVectorEnv)
        stepped.step()  # the gains are in the models once a command has been given
        self.simulation = simulation = native.simulation
        self._models = [simulation.model(i) for i in range(simulation.count)]
        model, steps = self._models[0], simulation.physics_steps
        self.threads = simulation.threads
        self._data = [mujoco.MjData(model) for _ in range(self.threads)]
        self._rollout = rollout.Rollout(nthread=self.threads if self.threads > 1 else 0)
        self._controls = []
        for action in stepped.actions:
            command = action_command(native.setting.side.action_map, action)
            self._controls.append(np.repeat((command.stiffness * command.position)[:, None], steps, axis=1))
        width = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._initial = np.zeros((simulation.count, width))
        self._path = np.zeros((simulation.count, steps, width))

    def begin(self) -> None:
        """Start where the environments start."""
        self._initial[:, 0] = 0.0
        self._initial[:, 1:] = np.concatenate([self.simulation.qpos, self.simulation.qvel], axis=1)

    @property
    def qpos(self) -> FloatArray:
        """Shape (N, nq), after the latest physics step."""
        return self._path[:, -1, 1 : 1 + self._models[0].nq]

    def step(self) -> None:
        """As many physics steps as the vector environment takes, in as many calls."""
        state, velocity = self._initial, slice(1 + self._models[0].nq, None)
        acceleration = np.zeros_like(state[:, velocity])
        for control in self._controls:
            self._rollout.rollout(
                self._models,
                self._data,
                state,
                control,
                nstep=control.shape[1],
                skip_checks=True,
                initial_warmstart=acceleration,
                state=self._path,
            )
            state = self._path[:, -1].copy()
            acceleration = (state - self._path[:, -2])[:, velocity] / self._models[0].opt.timestep

    def close(self) -> None:
        """Stop the threads."""
        self._rollout.close()
