"""Traces short enough to be kept: means over equal stretches of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from humanoid_sim.mit import FloatArray

__all__ = ["LONGEST", "thinned"]

LONGEST = 128
"""Values of a trace at most."""
_DIGITS = 5
"""That are kept of each: for plots, not for comparisons."""

Trace = tuple[float | None, ...]


def thinned(traces: Mapping[str, FloatArray], period: float) -> tuple[tuple[float, ...], dict[str, Trace]]:
    """The traces of an episode, at most `LONGEST` values each, and their times.

    Args:
        traces: by name, shape (K,), one value per policy step; NaN where there is none.
        period: s between two.

    Returns:
        Times in s since the start, the middles of the stretches; and by name the means over them, None where a stretch
        has no value. Traces without any value are left out.
    """
    count = min((len(values) for values in traces.values()), default=0)
    if not count:
        return (), {}
    edges = np.linspace(0, count, min(count, LONGEST) + 1).round().astype(int)
    times = tuple(round(float(0.5 * (a + 1 + b) * period), 6) for a, b in pairwise(edges))
    thin = {}
    for name, values in traces.items():
        known = ~np.isnan(values)
        if known.any():
            total = np.add.reduceat(np.where(known, values, 0.0), edges[:-1])
            number = np.add.reduceat(known.astype(np.int64), edges[:-1])
            thin[name] = tuple(_short(float(t / n)) if n else None for t, n in zip(total, number, strict=True))
    return times, thin


def _short(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if np.isfinite(value) else None
