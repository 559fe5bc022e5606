"""Buses that do what a test tells them, beside python-can's own virtual one."""

import itertools

import can
import pytest

from humanoid_sim.hardware.bus.address import BusAddress

_numbers = itertools.count()


@pytest.fixture
def address():
    """A virtual channel of this test's own."""
    return BusAddress("virtual", f"test-{next(_numbers)}")


@pytest.fixture
def peer(address):
    """The other end of that channel."""
    bus = can.Bus(interface="virtual", channel=address.channel)
    yield bus
    bus.shutdown()
