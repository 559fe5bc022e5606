"""Reward terms of a user's own: what they may be, and what they may give."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import FloatArray

RewardTerm = tuple[float, Callable[[StepSample], FloatArray | float]]
"""A weight, 1/s per unit of the term, and the term's value of a policy step: shape (...), or a number for all."""

_FORM = "expected (weight, function)"


def checked_terms(rewards: Mapping[str, RewardTerm] | None) -> dict[str, RewardTerm]:
    """Return the terms by name.

    Raises:
        InputError: one is not a weight with a function.
    """
    if not isinstance(rewards, Mapping | None):
        raise InputError(f"rewards: is {_kind(rewards)}, expected a (weight, function) by the name of each term")
    for name, term in (rewards or {}).items():
        if not isinstance(term, tuple | list) or len(term) != 2:
            raise InputError(f"rewards: {name} is {_kind(term)}, {_FORM}")
        if isinstance(term[0], bool) or not isinstance(term[0], Real) or not callable(term[1]):
            raise InputError(f"rewards: {name} is ({_kind(term[0])}, {_kind(term[1])}), {_FORM}")
    return dict(rewards or {})


def _kind(value: Any) -> str:
    if callable(value):
        return "a function"
    return f"{value}" if isinstance(value, Real) else f"a {type(value).__name__}"


def finite(value: Any) -> bool:
    """Return whether it is one finite number."""
    return isinstance(value, Real) and math.isfinite(value)


def term_value(name: str, term: RewardTerm, sample: StepSample, shape: tuple[int, ...]) -> FloatArray:
    """Return what a term gives for a policy step, shape (...).

    Raises:
        InputError: it is neither a value for each robot, nor a number for all of them.
    """
    given = term[1](sample)
    if type(given) in (float, int):  # not NumPy's scalars: in a batch they are a sum over all robots
        return np.full(shape, given, dtype=np.float64)
    try:
        value = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"rewards: {name} gives {_kind(given)}, expected numbers") from None
    if value.shape != shape:
        raise InputError(f"rewards: {name} has shape {value.shape}, expected {shape}: one value for each robot")
    return value


def require_finite(reward: FloatArray, terms: Mapping[str, FloatArray]) -> None:
    """Refuse rewards that are not finite.

    Args:
        reward: shape (...), 0 for robots that do not count.
        terms: what each adds to it, shape (...).

    Raises:
        InputError: one is not; it names the term and the first robot.
    """
    # of one robot by `math`: NumPy takes 20 times as long for a single number
    if math.isfinite(reward) if reward.ndim == 0 else np.isfinite(reward).all():
        return
    i = int(np.flatnonzero(~np.isfinite(np.ravel(reward)))[0])
    values = {name: float(np.ravel(term)[i]) for name, term in terms.items()}
    name, value = next(((n, v) for n, v in values.items() if not math.isfinite(v)), ("their sum", math.inf))
    raise InputError(f"rewards: {name} is {'nan' if math.isnan(value) else 'infinite'} in environment {i}")
