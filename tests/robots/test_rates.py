"""Periods in whole steps."""

import math

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.rates import MOST_STEPS, steps_per_period


@pytest.mark.parametrize(
    ("period", "step", "count"),
    [(0.02, 0.0005, 40), (1 / 200, 0.005, 1), (1 / 60, 1 / 480, 8), (0.005, 5e-7, MOST_STEPS)],
)
def test_counts_the_steps_of_a_period(period, step, count):
    assert steps_per_period(period, step) == count


@pytest.mark.parametrize(
    ("step", "problem"),
    [
        (0.0006, "the nearest that does is 0.000625 s (8"),
        (0.003, "the nearest that does is 0.0025 s (2"),
        (0.1, "the nearest that does is 0.005 s (1"),
        (math.inf, "the nearest that does is 0.005 s (1"),
        *((step, "expected at least 5e-07 s") for step in (-0.001, 0.0, 5e-324, 1e-9, math.nan)),
    ],
)
def test_refuses_a_step_that_does_not_divide_the_period(step, problem):
    with pytest.raises(InputError) as caught:
        steps_per_period(0.005, step)
    assert problem in str(caught.value)
