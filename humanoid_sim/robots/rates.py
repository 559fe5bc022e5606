"""Periods that must divide one another: physics step, control period, policy period."""

from __future__ import annotations

import math

from humanoid_sim.errors import InputError

__all__ = ["steps_per_period"]


def steps_per_period(period: float, step: float, what: str = "physics timestep") -> int:
    """How many steps of `step` make up `period`; both in s.

    Args:
        period: the longer one, such as the control period.
        step: the shorter one.
        what: what to call `step` in the message.

    Raises:
        InputError: either is not a positive number, or `step` does not divide `period` to within 1e-9; the message
            names the nearest step that does.
    """
    for name, value in ((what, step), ("period", period)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{what}: {value} s is no {name}, expected a finite number > 0")
    ratio = period / step
    count = max(round(ratio), 1)
    if abs(ratio - count) > 1e-9 * ratio:
        nearest = min((math.floor(ratio) or 1, math.ceil(ratio)), key=lambda n: abs(period / n - step))
        raise InputError(
            f"{what}: {step:g} s does not divide the period of {period:g} s; the nearest that does is "
            f"{period / nearest:g} s ({nearest} per period)"
        )
    return count
