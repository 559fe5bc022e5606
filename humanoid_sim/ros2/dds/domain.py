"""The DDS domain: which one, on which network interface, and who can be heard there.

The configuration is given to Cyclone DDS here, not by the environment, so that nothing leaves the machine unless an
interface is named.
"""

from __future__ import annotations

import os
from types import TracebackType
from typing import Any, Self

from humanoid_sim.errors import InputError, MissingPackageError

__all__ = ["LOOPBACK", "Participant", "configuration", "domain_id"]

LOOPBACK = "lo"
_LARGEST_DOMAIN = 232
"""Beyond it there are no UDP ports for one (DDSI-RTPS 2.5, 9.6.2)."""

_CONFIGURATION = """\
<CycloneDDS><Domain id="any">
 <General><Interfaces><NetworkInterface name="{interface}" multicast="true"/></Interfaces>\
<AllowMulticast>spdp</AllowMulticast></General>
 <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
  {peers}</Discovery>
 <Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility></Domain></CycloneDDS>"""
"""Multicast alone misses ROS 2 clients that are restricted to LOCALHOST, peers alone miss those that are not. 1.15 is
eProsima: Cyclone DDS and Fast DDS find each other without this, but exchange nothing, because the one rejects the type
objects of the other."""
_LOCAL_PEERS = '<Peers><Peer address="127.0.0.1"/></Peers>'


def domain_id() -> int:
    """The domain that `ROS_DOMAIN_ID` names; 0 without it.

    Raises:
        InputError: it is no domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= _LARGEST_DOMAIN):
        raise InputError(f"ROS_DOMAIN_ID: is '{text}', expected a whole number from 0 to {_LARGEST_DOMAIN}")
    return int(text)


def configuration(interface: str = LOOPBACK) -> str:
    """Cyclone DDS's configuration for one network interface; by default nothing leaves the machine."""
    return _CONFIGURATION.format(interface=interface, peers=_LOCAL_PEERS if interface == LOOPBACK else "")


class Participant:
    """This process in a domain, on one network interface. A context manager; a process has one in each domain."""

    def __init__(self, domain: int | None = None, interface: str = LOOPBACK) -> None:
        """Join.

        Args:
            domain: its id; None for that of `ROS_DOMAIN_ID`.
            interface: the only network interface that is used.

        Raises:
            InputError: the domain or the interface cannot be used.
            MissingPackageError: Cyclone DDS is not installed.
        """
        try:
            from cyclonedds.core import DDSException  # noqa: PLC0415 - an extra
            from cyclonedds.domain import Domain, DomainParticipant  # noqa: PLC0415
        except ImportError:
            raise MissingPackageError("cyclonedds", "dds", "DDS") from None
        self.domain = domain_id() if domain is None else domain
        self.interface = interface
        self._domain: Any = None
        try:
            self._domain = Domain(self.domain, configuration(interface))
            self.entity: Any = DomainParticipant(self.domain)
            """Cyclone DDS's."""
        except DDSException as error:
            self.close()
            raise InputError(
                f"DDS domain {self.domain} on network interface {interface}: cannot be joined: {error.msg}"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave, now and not when Python forgets it; writers and readers go too. May be called twice."""
        if self._domain is not None:
            self._domain.__del__()
            self._domain = None
