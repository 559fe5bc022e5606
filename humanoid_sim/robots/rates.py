"""Periods and delays in whole steps: physics step, control period, policy period."""

from __future__ import annotations

from humanoid_sim.errors import InputError

MOST_STEPS = 10_000  # of one period: more would take seconds to compute
LONGEST_DELAY = 10.0  # s


def steps_per_period(period: float, step: float, *, step_name: str = "physics_timestep") -> int:
    """Return how many steps of `step` make up `period`; both in s.

    Raises `InputError` with the nearest step that divides the period if this one does not, to within 1e-9.
    """
    least = period / MOST_STEPS
    if not step >= least * (1.0 - 1e-9):
        raise InputError(f"{step_name}: is {step:g} s, expected at least {least:g} s of a period of {period:g} s")
    ratio = period / step
    count = max(round(ratio), 1)
    if abs(ratio - count) > 1e-9 * ratio:
        nearest = min((max(int(ratio), 1), int(ratio) + 1), key=lambda n: abs(period / n - step))
        near = f"the nearest that does is {period / nearest:g} s ({nearest} per period)"
        raise InputError(f"{step_name}: {step:g} s does not divide the control period of {period:g} s; {near}")
    return count


def delay_steps(name: str, delay: float, physics_timestep: float) -> int:
    """Return a delay in physics steps; both times in s.

    Raises `InputError` with the nearest delay that is a multiple of the physics step if this one is not.
    """
    if not 0.0 <= delay <= LONGEST_DELAY:
        raise InputError(f"{name}: is {delay:g} s, expected 0 to {LONGEST_DELAY:g} s")
    steps = round(delay / physics_timestep)
    if abs(delay - steps * physics_timestep) > 1e-9:
        near = f"the nearest is {steps * physics_timestep:g} s"
        raise InputError(f"{name}: {delay:g} s is not a multiple of the physics step of {physics_timestep:g} s; {near}")
    return steps
