"""Returns and lengths of the episodes of a vector environment, counted the same for every library."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper

__all__ = ["EpisodeMeter"]


class EpisodeMeter(VectorWrapper):
    """Watches episodes go by; changes nothing."""

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        """Watch `env`, whose mean figures are those of the latest N episodes that ended."""
        super().__init__(env)
        self._returns, self._lengths = np.zeros(env.num_envs), np.zeros(env.num_envs, dtype=np.int64)
        self._ended: deque[tuple[float, int, bool]] = deque(maxlen=env.num_envs)
        self._info: dict[str, Any] = {}

    def reset(self, **options: Any) -> Any:
        """See `VectorEnv.reset`: all episodes begin."""
        self._returns[:], self._lengths[:] = 0.0, 0
        return super().reset(**options)

    def step(self, actions: Any) -> Any:
        """See `VectorEnv.step`."""
        result = super().step(actions)
        _, reward, terminated, truncated, self._info = result
        self._returns += reward
        self._lengths += 1
        for i in np.flatnonzero(terminated | truncated).tolist():
            self._ended.append((float(self._returns[i]), int(self._lengths[i]), bool(terminated[i])))
            self._returns[i], self._lengths[i] = 0.0, 0
        return result

    @property
    def mean_return(self) -> float:
        """Of the latest episodes; NaN before any has ended."""
        return self._mean(0)

    @property
    def mean_length(self) -> float:
        """Policy steps; NaN before any episode has ended."""
        return self._mean(1)

    @property
    def failed(self) -> float:
        """Share of them that ended because the robot failed."""
        return self._mean(2)

    def terms(self) -> dict[str, float]:
        """Of each reward term the mean over the robots, in the latest step."""
        means = {}
        terms = self._info.get("terms", {})
        for name, values in terms.items():
            mask = terms.get(f"_{name}")
            if mask is not None and mask.any():
                means[name] = float(values[mask].mean())
        return means

    def _mean(self, column: int) -> float:
        return float(np.mean([row[column] for row in self._ended])) if self._ended else float("nan")
