"""Address of a bus, `can0` or `interface:channel` for any interface of python-can, and how it is opened."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import re
import socket
import sys
from dataclasses import dataclass
from typing import Any

import can

from humanoid_sim.errors import InputError, RobotError, reason_of, require_known
from humanoid_sim.hardware.bus.frame import BITRATE


@dataclass(frozen=True, slots=True)
class BusAddress:
    """One channel of one of python-can's interfaces."""

    interface: str  # python-can's name of the driver: `socketcan`, `virtual`, `udp_multicast`, `slcan`, …
    channel: str  # for that driver: `can0`, `239.74.163.2`, `/dev/ttyACM0`, …

    def __str__(self) -> str:
        return self.channel if self.interface == "socketcan" else f"{self.interface}:{self.channel}"


def parse_address(text: str) -> BusAddress:
    """Return the channel that a text such as `can0` or `udp_multicast:239.74.163.2` names, or raise `InputError`.

    Everything after the first colon belongs to the channel, so that IPv6 groups and device paths need no quoting.
    """
    interface, colon, channel = text.strip().partition(":")
    if not colon:
        interface, channel = "socketcan", interface
    is_name = re.fullmatch(r"[^\s/]{1,15}", channel) if interface == "socketcan" else channel  # IFNAMSIZ of the kernel
    if not interface or not is_name:
        accepted = "a network interface such as can0, or interface:channel such as virtual:lite"
        raise InputError(f"bus: is '{text}', expected {accepted}")
    require_known("interface", (interface,), sorted(can.VALID_INTERFACES), f"bus '{text}': ")
    return BusAddress(interface, channel)


def parse_addresses(text: str) -> tuple[BusAddress, ...]:
    """Return the channels of a list such as `can0,can1`, in the order of the robot's buses, or raise as above."""
    addresses = tuple(parse_address(part) for part in text.split(","))
    for i, address in enumerate(addresses):
        if address in addresses[:i]:
            raise InputError(f"buses '{text}': {address} is named twice; one channel carries all motors by itself")
    return addresses


_WITHOUT_BITRATE = frozenset({"socketcan", "virtual", "udp_multicast", "socketcand"})  # none, or given elsewhere
_IP_MULTICAST_ALL = 49  # linux/in.h; Python's socket module does not name it
_IPV6_MULTICAST_ALL = 29  # linux/in6.h
_MOST_WAITING = 1000  # frames that a socket's buffer can hold, and more

# python-can logs what it then raises; without a handler of its own that would be printed beside our one line.
logging.getLogger("can").addHandler(logging.NullHandler())


def open_bus(address: BusAddress) -> can.BusABC:
    """Return an open bus; a `RobotError` of one line with the reason where it cannot be opened."""
    options: dict[str, Any] = {} if address.interface in _WITHOUT_BITRATE else {"bitrate": BITRATE}
    try:
        bus = can.Bus(interface=address.interface, channel=address.channel, **options)
    except Exception as error:  # every driver has exceptions of its own
        reason = f"{type(error).__name__}: {reason_of(error)}"
        if error_number(error) == errno.ENETDOWN:
            reason = f"it is down: sudo ip link set {address.channel} up type can bitrate {BITRATE} restart-ms 0"
        raise RobotError(f"{address}: cannot be opened: {reason}") from error
    if address.interface == "udp_multicast" and sys.platform.startswith("linux"):
        _receive_own_group_only(bus)
    return bus


def _receive_own_group_only(bus: can.BusABC) -> None:
    """Keep the groups of a machine apart.

    python-can binds every group to one port on all addresses, and Linux then hands each socket what comes for any group
    that anybody has joined: two buses would receive each other's motors.
    """
    # A kernel without the option leaves the groups as they were. python-can has bound the socket, so that other groups'
    # frames may lie in it already.
    with contextlib.suppress(OSError, can.CanError), socket.socket(fileno=os.dup(bus.fileno())) as own:
        is_six = own.family == socket.AF_INET6
        level, option = (socket.IPPROTO_IPV6, _IPV6_MULTICAST_ALL) if is_six else (socket.IPPROTO_IP, _IP_MULTICAST_ALL)
        own.setsockopt(level, option, 0)
        for _ in range(_MOST_WAITING):
            if bus.recv(0.0) is None:
                break


def error_number(error: BaseException) -> int | None:
    """Return the `errno` behind one of python-can's exceptions, which keeps it in one of three places or not at all."""
    cause: BaseException | None = error
    while cause is not None:
        for name in ("error_code", "errno"):
            number = getattr(cause, name, None)
            if isinstance(number, int):
                return number
        cause = cause.__cause__
    return None
