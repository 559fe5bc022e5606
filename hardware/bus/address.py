"""Where a bus is: `can0`, or `interface:channel` for any interface of python-can."""

from __future__ import annotations

import re
from dataclasses import dataclass

from humanoid_sim.errors import InputError, known_names

__all__ = ["BusAddress", "parse_address", "parse_addresses"]

_SOCKETCAN = "socketcan"
_ACCEPTED = "expected a network interface such as can0, or interface:channel such as virtual:lite"


@dataclass(frozen=True, slots=True)
class BusAddress:
    """One channel of one of python-can's interfaces."""

    interface: str
    """python-can's name of the driver: `socketcan`, `virtual`, `udp_multicast`, `slcan`, …"""
    channel: str
    """What that driver calls the channel: `can0`, `239.74.163.2`, `/dev/ttyACM0`, …"""

    def __str__(self) -> str:
        """As an operator writes it; a safety status names its source by it."""
        return self.channel if self.interface == _SOCKETCAN else f"{self.interface}:{self.channel}"


def parse_address(text: str) -> BusAddress:
    """The channel that a text such as `can0` or `udp_multicast:239.74.163.2` names.

    Everything after the first colon belongs to the channel, so that IPv6 groups and device paths need no quoting.

    Raises:
        InputError: no channel is named, or python-can has no such interface.
    """
    import can  # noqa: PLC0415 - 50 ms that a `--help` need not wait for

    text = text.strip()
    interface, colon, channel = text.partition(":")
    if not colon:
        interface, channel = _SOCKETCAN, text
    if not interface or not channel:
        raise InputError(f"bus '{text}': names no {'channel' if interface else 'interface'}; {_ACCEPTED}")
    known = can.VALID_INTERFACES
    if interface not in known:
        raise InputError(f"bus '{text}': {known_names('interface', interface, sorted(known))}")
    if interface == _SOCKETCAN and not re.fullmatch(r"[^\s/]{1,15}", channel):  # the kernel's own rule (IFNAMSIZ)
        raise InputError(f"bus '{text}': '{channel}' cannot be a network interface's name; {_ACCEPTED}")
    return BusAddress(interface, channel)


def parse_addresses(text: str) -> tuple[BusAddress, ...]:
    """The channels of a comma-separated list, `can0,can1`, in the order of the robot's buses.

    Raises:
        InputError: one of them cannot be read, or one is named twice.
    """
    addresses = tuple(parse_address(part) for part in text.split(","))
    for i, address in enumerate(addresses):
        if address in addresses[:i]:
            raise InputError(f"buses '{text}': {address} is named twice; one channel carries all motors by itself")
    return addresses
