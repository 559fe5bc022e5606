"""Hypothesis strategies for numbers and arrays that break floating-point code."""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from humanoid_sim.mit import FloatArray

__all__ = ["SPECIAL_NUMBERS", "any_arrays", "any_numbers", "moderate_numbers"]

SPECIAL_NUMBERS = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e39, -1e39, 1e308, -1e308, np.inf, -np.inf, np.nan)
"""Where floating-point code breaks: signed zero, subnormals, beyond float32, the largest, infinite, not a number."""

_DISTINCT = 5
"""Numbers drawn for one array; a longer one repeats them. What an example may draw is bounded, and thirty joints of
their own choosing would find nothing that five do not."""


@cache
def any_numbers() -> SearchStrategy[float]:
    """Any float at all, the troublesome ones often."""
    return st.sampled_from(SPECIAL_NUMBERS) | st.floats(-10.0, 10.0) | st.floats()


@cache
def moderate_numbers() -> SearchStrategy[float]:
    """Floats from -3 to 3, as positions, velocities and efforts of a robot that works."""
    return st.floats(-3.0, 3.0, allow_subnormal=False)


@cache
def any_arrays(n: int, numbers: SearchStrategy[float] | None = None) -> SearchStrategy[FloatArray]:
    """Arrays of shape (n,) of `numbers`, by default of `any_numbers()`.

    Without `numbers`, one odd value among moderate ones is as likely as an array that is odd throughout.
    """
    values = any_numbers() if numbers is None else numbers
    drawn = min(n, _DISTINCT)
    random = st.lists(values, min_size=drawn, max_size=drawn).map(lambda some: np.resize(np.array(some, float), n))
    if numbers is not None or n == 0:
        return random
    return st.builds(_with_one, st.just(n), st.integers(0, n - 1), values, moderate_numbers()) | random


def _with_one(n: int, i: int, odd: float, rest: float) -> FloatArray:
    array = np.full(n, rest)
    array[i] = odd
    return array
