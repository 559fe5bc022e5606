import math

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.simulation.delay import DelayLine, delay_steps


def test_a_sample_is_seen_when_its_delay_is_over():
    line = DelayLine(3)
    line.restart(10, "start")
    line.push(12, "a")
    line.push(14, "b")
    seen = [line.at(step) for step in range(10, 19)]
    assert seen == [(10, "start")] * 5 + [(12, "a")] * 2 + [(14, "b")] * 2


def test_without_delay_the_latest_is_seen_at_once():
    line = DelayLine(0)
    line.restart(0, "start")
    line.push(5, "a")
    assert line.at(5) == (5, "a")
    line.restart(7, "again")
    assert line.at(7) == (7, "again")


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
