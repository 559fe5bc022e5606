"""Mock motors in real time on python-can channels."""

import time

import pytest
from waiting import until

from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot


@pytest.fixture
def motors():
    with MockServer(load_robot("lite"), ["virtual:mock"]) as motors:
        yield motors


def test_the_shared_clock_waits_for_motors_that_are_late(motors):
    ahead = []

    def hold_up(mock):
        time.sleep(0.1)
        ahead.append(motors.clock() - mock.time)

    motors.call(hold_up)
    assert ahead[0] == pytest.approx(0.05), "s, and no more"
    until(lambda: motors.stood_still > 0.03)
