import math

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.rates import MOST_STEPS, delay_steps, steps_per_period


@pytest.mark.parametrize(
    ("period", "step", "count"), [(0.005, 0.0005, 10), (0.02, 0.0005, 40), (1 / 200, 0.005, 1), (1 / 60, 1 / 480, 8)]
)
def test_counts_the_steps_of_a_period(period, step, count):
    assert steps_per_period(period, step) == count


@pytest.mark.parametrize(
    ("period", "step", "nearest"),
    [(0.005, 0.0006, "0.000625 s (8"), (0.005, 0.003, "0.0025 s (2"), (0.005, 0.1, "0.005 s (1")],
)
def test_names_the_nearest_step_that_divides(period, step, nearest):
    with pytest.raises(InputError) as caught:
        steps_per_period(period, step)
    assert f"the nearest that does is {nearest}" in str(caught.value)


@pytest.mark.parametrize("bad", [0.0, -0.001, math.nan, math.inf])
def test_refuses_what_is_no_duration(bad):
    with pytest.raises(InputError, match="expected a finite number > 0"):
        steps_per_period(0.005, bad)
    with pytest.raises(InputError, match="expected a finite number > 0"):
        steps_per_period(bad, 0.0005)


@pytest.mark.parametrize(("period", "step"), [(0.005, 1e-9), (0.005, 1e-300), (0.005, 5e-324), (1e300, 0.0005)])
def test_refuses_more_steps_than_anybody_would_wait_for(period, step):
    with pytest.raises(InputError, match=r"^physics timestep: is .* s, expected at least .* 10000 steps of a control "):
        steps_per_period(period, step)
    assert steps_per_period(0.005, 5e-7) == MOST_STEPS


@pytest.mark.parametrize(("delay", "steps"), [(0.0, 0), (0.0005, 1), (0.0015, 3), (0.1, 200)])
def test_delays_in_steps(delay, steps):
    assert delay_steps("state_delay", delay, 0.0005) == steps


@pytest.mark.parametrize("delay", [-0.001, math.nan, math.inf, 1e308])
def test_refuses_what_is_no_delay(delay):
    with pytest.raises(InputError, match=r"^state_delay: is .* s, expected 0 to 10 s$"):
        delay_steps("state_delay", delay, 0.0005)


def test_names_the_nearest_multiple():
    with pytest.raises(InputError) as caught:
        delay_steps("command_delay", 0.0012, 0.0005)
    assert str(caught.value) == (
        "command_delay: 0.0012 s is not a multiple of the physics step of 0.0005 s; the nearest is 0.001 s"
    )
