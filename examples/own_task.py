"""A task of your own, alone and in a batch: hold the arms still in the robot's standby pose, without much effort.

    python examples/own_task.py

A task says what a policy step is worth and when an episode has failed. One class serves Gymnasium's environments, the
vector environment and training, because everything takes arrays `(..., n)`. To train a policy for it:

    python -m humanoid_sim.training train --task examples/own_task.py:HoldTask

Pass the class itself: `gymnasium.make(..., task=HoldTask)`; it needs no name.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.tasks.task import BoolArray, Task
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray


class HoldTask(Task):
    """Stay where the joints start; a joint that strays by a radian has failed.

    ======= ====== =============================================================
    term    weight value
    ======= ====== =============================================================
    pose    1.0    exp(-e²/0.1² rad²), e² the squared error, mean over the joints
    ======= ====== =============================================================
    """

    WEIGHTS: ClassVar[Mapping[str, float]] = MappingProxyType({"pose": 1.0, **Task.WEIGHTS})

    def _measure(self, sample: StepSample) -> tuple[dict[str, FloatArray], BoolArray]:
        error = sample.state.joint_position - self._pose
        pose = np.exp(np.square(error).mean(axis=-1) / -(0.1**2))
        return {"pose": pose}, (np.abs(error) > 1.0).any(axis=-1)

    def _describe_stray(self, sample: StepSample, i: int) -> str:
        error = np.abs(sample.state.joint_position[i] - self._pose)
        return f"joint {int(error.argmax())} strayed by {error.max():.2f} rad"


def main() -> None:
    """Two policies that know nothing of the task: one answers zeros, one something random."""
    env = PolicyEnv(SAMPLE_POLICY, "lite", "wave", task=HoldTask, episode_seconds=2.0)
    for name, spread in (("zeros", 0.0), ("random", 1.0)):
        rng = np.random.default_rng(0)
        env.reset(seed=0)
        earned, over = 0.0, False
        while not over:
            action = spread * rng.standard_normal(env.action_space.shape)
            _, reward, terminated, truncated, _ = env.step(action.astype(np.float32))
            earned, over = earned + float(reward), terminated or truncated
        print(f"{name}: {earned:.2f} of 2.00 earned, {'failed' if terminated else 'held out'}")
    env.close()

    envs = PolicyVectorEnv(8, SAMPLE_POLICY, "lite", "wave", task=HoldTask)
    envs.reset(seed=0)
    _, rewards, *_ = envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))
    print(f"eight at once: {rewards.mean():.4f} each in the first step")
    envs.close()


if __name__ == "__main__":
    main()
