"""What the plots of a metric share: the policies as rows, dots beside each other, limits and names of the axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.report.palette import COLOURS, candidate_colour
from humanoid_sim.regress.results import PolicyRun, Results

__all__ = ["Group", "axis_limits", "draw_dots", "groups", "spread"]

_GOLDEN = 0.618033988749895
"""Multiples of it, less their whole part, spread evenly over an interval however many there are."""
_LONGEST_NAME = 22
_DENSITY_ROOM = 0.12
"""Of the width of the values: room for the tails of their densities."""


@dataclass(frozen=True, slots=True)
class Group:
    """A policy, and its colour in every plot."""

    run: PolicyRun
    colour: str

    @property
    def name(self) -> str:
        """Short enough for an axis."""
        name = self.run.name
        return name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"


def groups(results: Results) -> list[Group]:
    """The baseline, if there is one, and the candidates."""
    found = [Group(c.run, candidate_colour(i)) for i, c in enumerate(results.candidates)]
    return found if results.baseline is None else [Group(results.baseline, COLOURS["baseline"]), *found]


def spread(count: int) -> FloatArray:
    """Numbers from 0 to 1 for dots beside each other: no chance in a page that must be the same every time."""
    numbers: FloatArray = np.mod(np.arange(1, count + 1) * _GOLDEN, 1.0)
    return numbers


def axis_limits(values: FloatArray) -> tuple[float, float]:
    """Of an axis that shows all of `values`, shape (K,)."""
    if not values.size:
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    room = _DENSITY_ROOM * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def draw_dots(axes: Axes, values: FloatArray, bottom: float, height: float, colour: str) -> None:
    """One per value, side by side in a row of that height."""
    axes.scatter(values, bottom + height * spread(values.size), s=9, c=colour, alpha=0.55, linewidths=0)
