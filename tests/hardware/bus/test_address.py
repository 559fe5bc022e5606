from __future__ import annotations

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_address, parse_addresses


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
def test_an_address_names_interface_and_channel(text: str, interface: str, channel: str) -> None:
    address = parse_address(text)
    assert (address.interface, address.channel) == (interface, channel)
    assert parse_address(str(address)) == address


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "names no channel"),
        ("virtual:", "names no channel"),
        (":can0", "names no interface"),
        ("socketkan:can0", "unknown interface 'socketkan'; known: .*socketcan"),
        ("socketcan:", "names no channel"),
        ("a-very-long-interface", "cannot be a network interface's name"),
        ("can 0", "cannot be a network interface's name"),
        ("../can0", "cannot be a network interface's name"),
    ],
)
def test_what_cannot_be_an_address_is_one_line(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        parse_address(text)
    assert "\n" not in str(caught.value)
    assert f"'{text}'" in str(caught.value)


def test_a_list_keeps_the_order_of_the_buses() -> None:
    assert [str(address) for address in parse_addresses("can1,can0")] == ["can1", "can0"]
    assert parse_addresses("virtual:a") == (BusAddress("virtual", "a"),)


def test_a_channel_named_twice_is_refused() -> None:
    with pytest.raises(InputError, match="can0 is named twice"):
        parse_addresses("can0,can0")
