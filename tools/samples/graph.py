"""Operators that the sample policies' networks are made of, beside those of every exported network."""

from __future__ import annotations

import numpy as np

from humanoid_sim.training.ppo.network import Graph

__all__ = ["SampleGraph"]


class SampleGraph(Graph):
    """A graph that slices, reshapes and picks."""

    def columns(self, value: str, start: int, stop: int) -> str:
        """Part of the second axis."""
        bounds = [self.constant([bound], dtype=np.int64) for bound in (start, stop, 1)]
        return self("Slice", value, *bounds)

    def reshape(self, value: str, *shape: int, name: str = "") -> str:
        """Return the same values in another shape."""
        return self("Reshape", value, self.constant(shape, dtype=np.int64), name=name)

    def pick(self, value: str, body: int) -> str:
        """One body of (arms, bodies, ...)."""
        return self("Gather", value, self.constant(body, dtype=np.int64), axis=1)

    def cross(self, columns: str) -> str:
        """Third columns (2 B, 2, 3, 1) of rotation matrices from the first two, (2 B, 2, 3, 2)."""
        x, y = (self("Gather", columns, self.constant([i], dtype=np.int64), axis=3) for i in (0, 1))
        forward, backward = (self.constant(order, dtype=np.int64) for order in ([1, 2, 0], [2, 0, 1]))
        plus = self("Mul", self("Gather", x, forward, axis=2), self("Gather", y, backward, axis=2))
        minus = self("Mul", self("Gather", x, backward, axis=2), self("Gather", y, forward, axis=2))
        return self("Sub", plus, minus)
