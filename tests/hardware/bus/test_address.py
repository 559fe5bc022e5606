"""Addresses, and opening them."""

import pytest

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.bus.address import (
    BusAddress,
    open_bus,
    parse_address,
    parse_addresses,
)


@pytest.mark.parametrize(
    ("text", "interface", "channel"),
    [
        ("can0", "socketcan", "can0"),
        (" can1 ", "socketcan", "can1"),
        ("virtual:lite", "virtual", "lite"),
        ("udp_multicast:239.74.163.2", "udp_multicast", "239.74.163.2"),
        ("udp_multicast:ff15::6d:63", "udp_multicast", "ff15::6d:63"),
        ("slcan:/dev/ttyACM0@115200", "slcan", "/dev/ttyACM0@115200"),
    ],
)
def test_an_address_names_interface_and_channel(text, interface, channel):
    address = parse_address(text)
    assert (address.interface, address.channel) == (interface, channel)
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "expected a network interface"),
        ("virtual:", "expected a network interface"),
        (":can0", "expected a network interface"),
        ("socketkan:can0", "unknown interface 'socketkan' .did you mean 'socketcan'"),
        ("a-very-long-interface", "expected a network interface"),
        ("../can0", "expected a network interface"),
    ],
)
def test_what_cannot_be_an_address_is_refused(text, says):
    with pytest.raises(InputError, match=says) as caught:
        parse_address(text)
    assert f"'{text}'" in str(caught.value)


def test_a_channel_named_twice_is_refused():
    with pytest.raises(InputError, match="can0 is named twice"):
        parse_addresses("can0,can0")


def test_an_adapter_that_is_not_there_is_one_line():
    with pytest.raises(RobotError, match=r"slcan:/dev/no-such-adapter: cannot be opened: \w+") as caught:
        open_bus(BusAddress("slcan", "/dev/no-such-adapter"))
    assert "\n" not in str(caught.value)
