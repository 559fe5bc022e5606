"""Rollouts as a Minari dataset, which offline learners read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.errors import InputError, needing

with needing("minari", "minari", "humanoid_sim.envs.minari_export"):
    import minari
    from minari.data_collector.episode_buffer import EpisodeBuffer

Array = npt.NDArray[Any]


def export_rollouts(
    env: gymnasium.Env[Array, Array],
    dataset_id: str,
    *,
    episodes: int,
    policy: Callable[[Array], Array] | None = None,
    seed: int = 0,
    on_episode: Callable[[int, float], None] | None = None,
    **about: Any,
) -> minari.MinariDataset:
    """Run a policy in an environment, and write what happened where Minari keeps its datasets (`MINARI_DATASETS_PATH`).

    `minari.load_dataset` gives it back, and `recover_environment` the environment. The reward's terms are kept as infos
    of each step; an episode that a fault ended is in it, with its last step terminated. Raises `InputError` if there is
    such a dataset, the number of episodes is below 1, or this is not a policy's environment.

    Args:
        env: a policy's environment, from `gymnasium.make`; it stays open.
        dataset_id: `[namespace/]name-v0`.
        policy: from an observation, shape (N,), to a raw action, shape (m,); None for the checkpoint that the
            environment was made with.
        seed: of the first episode; the following ones have the numbers after it.
        on_episode: called after each with how many there are, and its return.
        about: as `minari.create_dataset_from_buffers` takes it: `author`, `algorithm_name`, `description`, …
    """
    ours = env.unwrapped
    if not isinstance(ours, PolicyEnv):
        raise InputError(f"env: is a {type(ours).__name__}, expected a policy's environment")
    if episodes < 1:
        raise InputError(f"episodes: is {episodes}, expected at least 1")
    if dataset_id in minari.list_local_datasets():
        raise InputError(
            f"dataset_id: there is a local dataset {dataset_id!r} already; delete it, or raise its version"
        )
    buffers = []
    for i in range(episodes):
        buffers.append(_episode(env, ours, policy, seed + i, i))
        if on_episode is not None:
            on_episode(i + 1, float(np.sum(buffers[-1].rewards)))
    return minari.create_dataset_from_buffers(dataset_id, buffers, env=env, **about)


def _episode(
    env: gymnasium.Env[Array, Array], ours: PolicyEnv, policy: Callable[[Array], Array] | None, seed: int, number: int
) -> EpisodeBuffer:
    observation, info = env.reset(seed=seed)
    observations, actions, rewards, ends, infos = [observation], [], [], [], []
    over = False
    while not over:
        chosen = ours.scenario.policy(observation, info["frame"]) if policy is None else policy(observation)
        action = np.asarray(chosen, dtype=np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        observations.append(observation)
        actions.append(action)
        rewards.append(float(reward))
        ends.append((terminated, truncated))
        infos.append(info.get("terms", {}))
    names = {name: None for terms in infos for name in terms}
    terms = {name: np.array([float(step.get(name, 0.0)) for step in infos]) for name in names}
    return EpisodeBuffer(
        id=number,
        seed=seed,
        observations=np.array(observations),
        actions=np.array(actions),
        rewards=rewards,
        terminations=[bool(terminated) for terminated, _ in ends],
        truncations=[bool(truncated) for _, truncated in ends],
        infos=terms,
    )
