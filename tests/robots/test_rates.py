import math

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.rates import steps_per_period


@pytest.mark.parametrize(
    ("period", "step", "count"), [(0.005, 0.0005, 10), (0.02, 0.0005, 40), (1 / 200, 0.005, 1), (1 / 60, 1 / 480, 8)]
)
def test_counts_the_steps_of_a_period(period: float, step: float, count: int) -> None:
    assert steps_per_period(period, step) == count


@pytest.mark.parametrize(
    ("period", "step", "nearest"),
    [(0.005, 0.0006, "0.000625 s (8"), (0.005, 0.003, "0.0025 s (2"), (0.005, 0.1, "0.005 s (1")],
)
def test_names_the_nearest_step_that_divides(period: float, step: float, nearest: str) -> None:
    with pytest.raises(InputError) as caught:
        steps_per_period(period, step)
    assert f"the nearest that does is {nearest}" in str(caught.value)


@pytest.mark.parametrize("bad", [0.0, -0.001, math.nan, math.inf])
def test_refuses_what_is_no_duration(bad: float) -> None:
    with pytest.raises(InputError, match="expected a finite number > 0"):
        steps_per_period(0.005, bad)
    with pytest.raises(InputError, match="expected a finite number > 0"):
        steps_per_period(bad, 0.0005)
