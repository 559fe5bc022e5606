"""Periods that must divide one another: physics step, control period, policy period."""

from __future__ import annotations

import math

from humanoid_sim.errors import InputError

MOST_STEPS = 10_000
"""Steps of one period that are accepted: beyond it a period would take seconds to compute, or never end."""


def steps_per_period(period: float, step: float, *, step_name: str = "physics timestep") -> int:
    """Return how many steps of `step` make up `period`; both in s.

    Raises:
        InputError: either is not a positive number, `period` has more than `MOST_STEPS` steps, or `step` does not
            divide it to within 1e-9; the message then names the nearest step that does.
    """
    for name, value in ((step_name, step), ("control period", period)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: is {value} s, expected a finite number > 0")
    ratio = period / step
    if ratio > MOST_STEPS * (1.0 + 1e-9):  # infinite too
        raise InputError(
            f"{step_name}: is {step:g} s, expected at least {period / MOST_STEPS:g} s, which makes {MOST_STEPS} steps "
            f"of a control period of {period:g} s"
        )
    count = max(round(ratio), 1)
    if abs(ratio - count) > 1e-9 * ratio:
        nearest = min((math.floor(ratio) or 1, math.ceil(ratio)), key=lambda n: abs(period / n - step))
        raise InputError(
            f"{step_name}: {step:g} s does not divide the control period of {period:g} s; the nearest that does is "
            f"{period / nearest:g} s ({nearest} per period)"
        )
    return count
