"""Walking robots as stable-baselines3 trains them: pushed now and then, seen through the gait and its symmetry."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnvWrapper

from humanoid_sim.envs.stable_baselines import StableBaselinesVecEnv
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.simulation.push import PUSH_DURATION, push_wrench
from tools.samples.walking.gait import (
    ANSWERS,
    INPUTS,
    MOST,
    OBSERVATIONS,
    awake,
    from_canonical,
    gait,
    network_input,
    to_canonical,
)
from tools.samples.walking.stages import Stage

__all__ = ["PRIVILEGED", "LearningEnv"]

Float32Array = npt.NDArray[np.float32]

PRIVILEGED = 5
"""Values after the network's input that only the critic sees: base velocity in the heading frame, its height, and the
vertical velocity."""


class LearningEnv(VecEnvWrapper):
    """The network's view of `PolicyVectorEnv`."""

    def __init__(self, envs: PolicyVectorEnv, stage: Stage, seed: int) -> None:
        """Take over `envs`.

        Args:
            envs: with the task `walking`.
            stage: says how they are pushed, in any horizontal direction.
            seed: of the pushes.
        """
        wide = np.full(INPUTS + PRIVILEGED, np.inf, dtype=np.float32)
        most = np.full(ANSWERS, MOST, dtype=np.float32)
        super().__init__(
            StableBaselinesVecEnv(envs),
            gymnasium.spaces.Box(-wide, wide),
            gymnasium.spaces.Box(-most, most),
        )
        self._robots = envs
        self._stage, self._chance = stage, envs.scenario.contract.policy_dt / stage.push_interval
        self._random = np.random.default_rng(seed)
        model, body = envs.simulation.model(0), envs.scenario.description.base.body
        self._mass = float(model.body_subtreemass[model.body(body).id])
        self._push_steps = round(PUSH_DURATION / envs.scenario.contract.policy_dt)
        self._left = np.zeros(envs.num_envs, dtype=np.int64)
        self._wrench = np.zeros((envs.num_envs, 6))
        self._canonical = np.zeros((envs.num_envs, OBSERVATIONS), dtype=np.float32)
        self._mirrored = np.zeros(envs.num_envs, dtype=np.bool_)
        self.sums: dict[str, float] = {}
        self.count = 0

    def reset(self) -> Float32Array:
        """Start an episode in every environment."""
        return self._seen(np.asarray(self.venv.reset()))

    def step_async(self, actions: Float32Array) -> None:
        """Say what to add to the gait in the next step."""
        raw = from_canonical(gait(self._canonical, actions), self._mirrored)
        self._pushes()
        self.venv.step_async(raw)

    def _pushes(self) -> None:
        """Push in the next step. A force lasts as long as `play`'s; where there are both, half of them are either."""
        stage = self._stage
        if max(stage.push, stage.velocity_push) <= 0.0:
            return
        self._left = np.maximum(self._left - 1, 0)
        begins = np.flatnonzero((self._random.random(self.num_envs) < self._chance) & (self._left == 0))
        angle = self._random.uniform(-np.pi, np.pi, len(begins))
        strength = self._random.random(len(begins))
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        share = 0.5 if stage.push and stage.velocity_push else float(stage.velocity_push > 0.0)
        is_sudden = self._random.random(len(begins)) < share
        if is_sudden.any():
            change = np.zeros((self.num_envs, 3))
            change[begins[is_sudden], :2] = stage.velocity_push * (strength[:, None] * direction)[is_sudden]
            self._robots.simulation.speed_up(change)
        by_force = begins[~is_sudden]
        self._left[by_force] = self._push_steps
        self._wrench[by_force] = push_wrench(stage.push * (strength[:, None] * direction)[~is_sudden], self._mass)
        self._robots.wrench = np.where(self._left[:, None] > 0, self._wrench, 0.0)

    def step_wait(self) -> Any:
        """Take the step; see `StableBaselinesVecEnv.step_wait`."""
        observation, reward, over, infos = self.venv.step_wait()
        for i in np.flatnonzero(over).tolist():
            final, _ = to_canonical(awake(infos[i]["terminal_observation"]))
            command = final[6:9]
            infos[i]["terminal_observation"] = np.concatenate([network_input(final), command, [0.76, 0.0]]).astype(
                np.float32
            )
        return self._seen(np.asarray(observation)), reward, over, infos

    def _seen(self, observation: Float32Array) -> Float32Array:
        self._canonical, self._mirrored = to_canonical(awake(observation))
        base = self._robots.simulation.base
        assert base is not None
        told = np.concatenate(
            [base.planar_velocity, base.height[:, None], base.linear_velocity[:, 2:]], axis=1, dtype=np.float32
        )
        told[:, 1:3] *= np.where(self._mirrored, -1.0, 1.0)[:, None]
        return np.concatenate([network_input(self._canonical), told], axis=1, dtype=np.float32)
