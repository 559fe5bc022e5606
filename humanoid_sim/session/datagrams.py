"""Datagrams of other programs on this machine: the sockets that they come by, and what they hold."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import NamedTuple

import numpy as np

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray

_LONGEST = 1 << 14  # bytes; no message is longer


class Mailbox:
    """A datagram socket at a path, whose senders are of this user alone."""

    def __init__(self, path: Path) -> None:
        """Open the socket. Raises `InputError` if that fails."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        try:
            self._socket.bind(str(path))
        except OSError as error:
            self._socket.close()
            raise InputError(f"{path}: cannot listen: {error.strerror or error}") from None
        queue = Path("/proc/sys/net/unix/max_dgram_qlen").read_text(encoding="ascii")
        self.capacity = int(queue) + 1  # datagrams that wait before their senders must

    def take(self) -> list[tuple[bytes, object]]:
        """Return everything that has come, with the address of its sender; a flood costs a bounded time."""
        found: list[tuple[bytes, object]] = []
        try:
            while len(found) < self.capacity:
                found.append(self._socket.recvfrom(_LONGEST))
        except OSError:  # nothing more
            return found
        return found

    def close(self) -> None:
        self._socket.close()


class Message(NamedTuple):
    """A request, or data: a word and its arguments, producer, token and stamp, a line each; then float64 values."""

    word: str
    rest: str
    producer: str  # name and process id
    token: str  # the message's own, which its answer repeats
    stamp: int  # ns, when what it is made of arrived, or what its sender had seen was so
    values: FloatArray
    sender: str  # its address for the answer; empty without one

    def age(self) -> float:  # s
        return 1e-9 * (monotonic_ns() - self.stamp)


def read_message(datagram: bytes, sender: object = None) -> Message:
    """Return what a datagram holds, which may be anything."""
    *lines, body = (*datagram.split(b"\n", 4), b"", b"", b"", b"")[:5]
    text, producer, token, stamp = (line.decode(errors="replace") for line in lines)
    word, _, rest = text.partition(" ")
    values = np.frombuffer(body[: len(body) // 8 * 8], dtype="<f8")
    address = sender if isinstance(sender, str) else ""
    seen = int(stamp[:20]) if stamp.isdecimal() else 0
    return Message(word, rest, producer[:80] or "?", token, seen, values, address)
