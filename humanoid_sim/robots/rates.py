"""Periods in whole steps: physics step, control period, policy period."""

from __future__ import annotations

from humanoid_sim.errors import InputError

MOST_STEPS = 10_000  # of one period: more would take seconds to compute


def steps_per_period(period: float, step: float) -> int:
    """Return how many steps of `step` make up `period`; both in s.

    Raises `InputError` with the nearest step that divides the period if this one does not, to within 1e-9.
    """
    least = period / MOST_STEPS
    if not step >= least * (1.0 - 1e-9):
        raise InputError(f"physics_timestep: is {step:g} s, expected at least {least:g} s of a period of {period:g} s")
    ratio = period / step
    count = max(round(ratio), 1)
    if abs(ratio - count) > 1e-9 * ratio:
        nearest = min((max(int(ratio), 1), int(ratio) + 1), key=lambda n: abs(period / n - step))
        near = f"the nearest that does is {period / nearest:g} s ({nearest} per period)"
        raise InputError(f"physics_timestep: {step:g} s does not divide the control period of {period:g} s; {near}")
    return count
