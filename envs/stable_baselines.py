"""The vector environment as stable-baselines3 wants it: its own interface, older than Gymnasium's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import VectorEnv

from humanoid_sim.envs.resets import require_same_step
from humanoid_sim.errors import InputError, needing
from humanoid_sim.mit import BoolArray, Float32Array

with needing("stable-baselines3", "rl", "humanoid_sim.envs.stable_baselines"):
    from stable_baselines3.common.vec_env import VecEnv

Indices = None | int | Iterable[int]


class StableBaselinesVecEnv(VecEnv):
    """A Gymnasium vector environment for stable-baselines3.

    That starts an episode in the step that ends the last one, so the environment must as well:
    `gymnasium.make_vec(..., autoreset_mode="SameStep")`.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        """Take over `envs`; closing this closes them. Raises `InputError` if they start episodes another way."""
        require_same_step(envs, "stable-baselines3")
        self.envs = envs
        self._actions: Float32Array | None = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Float32Array:
        """Start an episode in every environment, with the seeds and options that were set for it.

        Raises `InputError` if the options differ between environments.
        """
        options = self._options[0]
        if any(other != options for other in self._options):
            raise InputError("options: differ between environments, expected the same for all")
        observation, _ = self.envs.reset(seed=self._seeds, options=options or None)
        self._reset_seeds()
        self._reset_options()
        return np.asarray(observation)

    def step_async(self, actions: Float32Array) -> None:
        """Say what to do in the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Float32Array, Float32Array, BoolArray, list[dict[str, Any]]]:
        """Take the step: observations, rewards, which episodes have ended, and an info of each environment.

        The info of an episode that has ended has `terminal_observation` and `TimeLimit.truncated`, and the `fault` that
        ended it, if one did.
        """
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        over = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        faults = info.get("final_info", {}).get("fault")
        for i in np.flatnonzero(over).tolist():
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            if faults is not None and faults[i]:
                infos[i]["fault"] = faults[i]
        return observation, reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Return a picture of each environment."""
        pictures: Any = self.envs.render()
        return [None] * self.num_envs if pictures is None else list(pictures)

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the vector environment or of a wrapper around it, once for each of these environments.

        Raises `AttributeError` if neither has one of that name.
        """
        owner = self.envs if hasattr(self.envs, attr_name) else self.envs.unwrapped
        return [getattr(owner, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of the vector environment, below the wrappers that are around it.

        Raises `InputError` if it is only for some of the environments.
        """
        if len(list(self._get_indices(indices))) < self.num_envs:
            raise InputError(f"{attr_name}: the environments are one, expected a value for all of them")
        setattr(self.envs.unwrapped, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the vector environment once; its result stands for each of these environments."""
        result = getattr(self.envs, method_name)(*method_args, **method_kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Indices = None) -> list[bool]:
        """Return whether a wrapper of single environments is around them: there is none around a native vector."""
        return [False] * len(list(self._get_indices(indices)))
