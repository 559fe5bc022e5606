"""The DDS domain: which one, and on which network interface.

The configuration is given to Cyclone DDS here, not by the environment, so that nothing leaves the machine unless an
interface is named. But Cyclone DDS receives on all addresses of the machine, whatever the configuration says: its
sockets are bound to the interface's device as well, and the kernel keeps to that.
"""

from __future__ import annotations

import os
from typing import Any, Self

from humanoid_sim.client import network_on
from humanoid_sim.errors import InputError, needing

LOOPBACK = "lo"
_LARGEST_DOMAIN = 232  # beyond it there are no UDP ports for one (DDSI-RTPS 2.5, 9.6.2)

_CONFIGURATION = """\
<CycloneDDS><Domain id="any">
 <General><Interfaces><NetworkInterface name="{interface}" multicast="true"/></Interfaces>\
<AllowMulticast>spdp</AllowMulticast><EnableMulticastLoopback>{loopback}</EnableMulticastLoopback></General>
 <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
  {peers}</Discovery>
 <Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility></Domain></CycloneDDS>"""
"""Multicast alone misses ROS 2 clients that are restricted to LOCALHOST, peers alone miss those that are not. 1.15 is
eProsima: Cyclone DDS and Fast DDS find each other without this, but exchange nothing, because the one rejects the type
objects of the other."""
_LOCAL_PEERS = '<Peers><Peer address="127.0.0.1"/></Peers>'


def _named_domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= _LARGEST_DOMAIN):
        raise InputError(f"ROS_DOMAIN_ID: is '{text}', expected a whole number from 0 to {_LARGEST_DOMAIN}")
    return int(text)


class Participant:
    """This process in a domain, on one network interface. A context manager; a process has one in each domain."""

    def __init__(self, domain: int | None = None, interface: str = LOOPBACK) -> None:
        """Join a domain, None for that of `ROS_DOMAIN_ID`, on one network interface alone.

        An interface other than loopback leads to other machines alone: programs on this one would otherwise meet a
        robot twice that is on both. Raises `InputError` if the domain or the interface cannot be used.
        """
        with needing("cyclonedds", "dds", "DDS"):
            from cyclonedds.core import DDSException  # noqa: PLC0415 - an extra
            from cyclonedds.domain import Domain, DomainParticipant  # noqa: PLC0415
        self.domain = _named_domain() if domain is None else domain
        self.interface = interface
        self._domain: Any = None
        is_local = interface == LOOPBACK
        peers, loopback = (_LOCAL_PEERS, "true") if is_local else ("", "false")
        configuration = _CONFIGURATION.format(interface=interface, loopback=loopback, peers=peers)
        try:
            with network_on(interface, from_here=is_local):
                self._domain = Domain(self.domain, configuration)
                self.entity: Any = DomainParticipant(self.domain)  # Cyclone DDS's
        except (DDSException, OSError) as error:
            self.close()
            why = error.msg if isinstance(error, DDSException) else error.strerror
            reason = f"cannot be joined: {why}; expected an interface that is up and has an IPv4 address"
            raise InputError(f"DDS domain {self.domain} on network interface {interface}: {reason}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave, now and not when Python forgets it; writers and readers go too. May be called twice."""
        if self._domain is not None:
            self._domain.__del__()
            self._domain = None
