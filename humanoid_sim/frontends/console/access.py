"""Access to the console's page: its tokens, the address it was printed with, and how much a page may ask for.

A token is the first part of a path. Without one there is neither page nor socket. `Host` and `Origin` are compared with
the printed address, not with each other: a name that somebody else lets point to this machine passes for neither.
"""

from __future__ import annotations

import ipaddress
import secrets
from dataclasses import dataclass, field
from enum import Enum

from humanoid_sim.errors import InputError

_HTTP_PORT = 80
"""Port that browsers leave out of an address."""


class Access(Enum):
    """Rights that an address gives."""

    CONTROL = "control"
    READ_ONLY = "read-only"


class RefusedError(Exception):
    """A request that is not served; `status` is HTTP's."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


def checked_host(host: str) -> str:
    """Return the address to serve on.

    Raises `InputError` if it is not one address of this machine. A page checks what it is called, so it needs one name.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise InputError(f"--host: is '{host}', expected an address of this machine, such as 192.168.1.20") from None
    if address.is_unspecified or address.is_multicast:
        raise InputError(f"--host: is {host}, expected the one address at which browsers reach this machine")
    return str(address)


@dataclass(frozen=True, slots=True)
class Gate:
    """Decides about requests. Its tokens are new in each process."""

    host: str
    port: int
    tokens: dict[Access, str] = field(default_factory=lambda: {access: secrets.token_urlsafe(24) for access in Access})

    @property
    def authority(self) -> str:
        """Return what a browser that was given the printed address sends as `Host`."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == _HTTP_PORT else f"{host}:{self.port}"

    @property
    def origin(self) -> str:
        """Return what it sends as `Origin`."""
        return f"http://{self.authority}"

    def address(self, access: Access) -> str:
        """To be printed."""
        return f"{self.origin}/{self.tokens[access]}/"

    def admit(self, path: str, hosts: list[str], origins: list[str], *, is_socket: bool) -> tuple[Access, str]:
        """Return what a request may do, and the path behind its token, such as `page.js`.

        Raises `RefusedError` if it is not served.

        Args:
            origins: all headers `Origin`; browsers leave them out of some requests for pages, never of sockets.
        """
        if hosts != [self.authority]:
            raise RefusedError(403, "Host is not the printed address")
        if origins != [self.origin] and (is_socket or origins):
            raise RefusedError(403, "Origin is not the printed address")
        token, _, rest = path.partition("?")[0].removeprefix("/").partition("/")
        given, found = token.encode(errors="replace"), None
        for access, expected in self.tokens.items():
            if secrets.compare_digest(given, expected.encode()):
                found = access
        if found is None:
            raise RefusedError(404, "not found")
        return found, rest
