"""Periods and delays in whole steps: physics step, control period, policy period."""

from __future__ import annotations

import math

from humanoid_sim.errors import InputError

MOST_STEPS = 10_000
"""Steps of one period that are accepted: beyond it a period would take seconds to compute, or never end."""

LONGEST_DELAY = 10.0
"""s; far more than any bus, and few enough steps to keep."""


def steps_per_period(period: float, step: float, *, step_name: str = "physics timestep") -> int:
    """Return how many steps of `step` make up `period`; both in s.

    Raises `InputError` if either is not a positive number, `period` has more than `MOST_STEPS` steps, or `step` does
    not divide it to within 1e-9; the message then names the nearest step that does.
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


def delay_steps(name: str, delay: float, physics_timestep: float) -> int:
    """Return a delay in physics steps; both times in s.

    Raises `InputError` if it is negative, longer than `LONGEST_DELAY`, or not a multiple of the physics step; the
    message names the nearest that is.
    """
    if not 0.0 <= delay <= LONGEST_DELAY:
        raise InputError(f"{name}: is {delay:g} s, expected 0 to {LONGEST_DELAY:g} s")
    steps = round(delay / physics_timestep)
    if abs(delay - steps * physics_timestep) > 1e-9:
        raise InputError(
            f"{name}: {delay:g} s is not a multiple of the physics step of {physics_timestep:g} s; the nearest is "
            f"{steps * physics_timestep:g} s"
        )
    return steps
