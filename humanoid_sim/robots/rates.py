"""Periods in whole steps: physics step, control period, policy period."""

from __future__ import annotations

from humanoid_sim.errors import InputError

_MOST_STEPS = 10_000  # of one period: more would take seconds to compute


def steps_per_period(period: float, step: float) -> int:
    """Return how many steps of `step` make up `period`; both in s. Raises `InputError` if that is no whole number."""
    count = max(round(period / step), 1) if step > 0.0 else 0
    if not 0 < count <= _MOST_STEPS or abs(period / step - count) > 1e-9 * count:
        near = f", such as {period / min(max(count, 1), _MOST_STEPS):g} s"
        raise InputError(f"physics_timestep: {step:g} s does not divide the control period of {period:g} s{near}")
    return count
