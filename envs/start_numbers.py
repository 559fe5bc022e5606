"""The random numbers that episodes start from: each environment's own stream, drawn ahead for many episodes at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding

from humanoid_sim.mit import FloatArray

__all__ = ["StartNumbers"]

IndexArray = npt.NDArray[np.intp]

_EPISODES = 16
"""Drawn at a time."""


class StartNumbers:
    """Uniform numbers in [0, 1) for N environments.

    An environment's are those that a single one draws from Gymnasium's `np_random` with the same seed: a generator
    gives the same numbers whether it is asked for one episode's or for a block of several.
    """

    def __init__(self, count: int, width: int) -> None:
        """Set up.

        Args:
            count: N.
            width: k, numbers that one start takes.
        """
        self._generators: list[np.random.Generator | None] = [None] * count
        self.seeds = np.zeros(count, dtype=np.uint64)
        """Shape (N,), what the environments were last seeded with (of a longer seed the lowest 64 bits)."""
        self._blocks = np.zeros((count, _EPISODES, width))
        self._next = np.full(count, _EPISODES)

    @property
    def generators(self) -> tuple[np.random.Generator, ...]:
        """The streams; some of what they have drawn lies in the blocks. Any that has no seed yet gets one."""
        return tuple(self._generator(i) for i in range(len(self._generators)))

    def seed(self, indices: IndexArray, seeds: Sequence[int | None]) -> None:
        """Start streams anew.

        Args:
            indices: shape (k,), environments.
            seeds: k of them; None leaves a stream as it is, and draws a seed where there is none.
        """
        for i, seed in zip(indices.tolist(), seeds, strict=True):
            if seed is not None:
                self._start(i, seed)
            else:
                self._generator(i)

    def take(self, indices: IndexArray) -> FloatArray:
        """The numbers of the next start of each of these environments, shape (k, width)."""
        for i in indices[self._next[indices] == _EPISODES].tolist():
            self._blocks[i] = self._generator(i).random(self._blocks.shape[1:])
            self._next[i] = 0
        numbers: FloatArray = self._blocks[indices, self._next[indices]]
        self._next[indices] += 1
        return numbers

    def _generator(self, i: int) -> np.random.Generator:
        generator = self._generators[i]
        return self._start(i, None) if generator is None else generator

    def _start(self, i: int, seed: int | None) -> np.random.Generator:
        generator, used = seeding.np_random(seed)
        self._generators[i] = generator
        self.seeds[i] = used % 2**64
        self._next[i] = _EPISODES
        return generator
