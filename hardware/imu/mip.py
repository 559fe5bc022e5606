"""MicroStrain Inertial Packets (MIP): bytes to packets and fields, and back. Pure; no device, no clock.

Source: the data communications protocol in the 3DM-CV7 user manual (MicroStrain by HBK, files.microstrain.com, "Data
Overview" and "Commands"), and the manufacturer's MIT-licensed mip_sdk for the quaternion's convention.

    packet: 0x75 0x65 | descriptor set u8 | payload length u8 | fields | checksum 2 bytes
    field:  length u8, these two bytes included | descriptor u8 | data, big-endian

The checksum is Fletcher's over everything before it, both sums modulo 256, the running sum first.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

_SYNC = b"\x75\x65"
_HEADER = 4
"""Bytes before the payload."""
_CHECKSUM = 2


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a packet."""

    descriptor: int
    data: bytes

    def floats(self, count: int) -> tuple[float, ...] | None:
        """Return the data as `count` 32-bit floats; None if it has another length."""
        return struct.unpack(f">{count}f", self.data) if len(self.data) == 4 * count else None


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet whose checksum was right."""

    descriptor_set: int
    fields: tuple[Field, ...]

    def field(self, descriptor: int) -> Field | None:
        """Return the first field of that descriptor."""
        return next((field for field in self.fields if field.descriptor == descriptor), None)


def checksum(data: bytes) -> bytes:
    """Fletcher's checksum of everything from the sync bytes to the end of the payload."""
    first = second = 0
    for byte in data:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return bytes((first, second))


def encode_packet(descriptor_set: int, fields: Iterable[Field]) -> bytes:
    """Return the bytes of a packet.

    Raises:
        ValueError: if a field or the payload is longer than its length byte can say.
    """
    payload = b"".join(bytes((len(field.data) + 2, field.descriptor)) + field.data for field in fields)
    packet = _SYNC + bytes((descriptor_set, len(payload))) + payload
    return packet + checksum(packet)


class PacketReader:
    """Finds packets in a stream that may begin anywhere, lose bytes and hold others.

    After a wrong checksum it looks for the next sync bytes right behind those that misled it, not behind the length
    that the damaged packet claimed: a lost byte costs one packet and not two.
    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self._buffer = bytearray()
        self.damaged = 0
        """Packets whose checksum was wrong or whose fields did not fill them."""
        self.skipped = 0
        """Bytes that belonged to no packet."""

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Take bytes and give the packets that they complete. To be iterated to its end."""
        self._buffer += data
        while self._seek_sync():
            size = _HEADER + self._buffer[3] + _CHECKSUM if len(self._buffer) >= _HEADER else len(self._buffer) + 1
            if len(self._buffer) < size:
                return
            whole = bytes(self._buffer[:size])
            fields = _fields(whole[_HEADER:-_CHECKSUM]) if checksum(whole[:-_CHECKSUM]) == whole[-_CHECKSUM:] else None
            if fields is None:
                self.damaged += 1
                self._skip(1)
            else:
                del self._buffer[:size]
                yield Packet(whole[2], fields)

    def _seek_sync(self) -> bool:
        """Drop what cannot begin a packet; whether the buffer begins with sync bytes now."""
        start = self._buffer.find(_SYNC)
        if start < 0:
            keep = self._buffer.endswith(_SYNC[:1])
            self._skip(len(self._buffer) - keep)
            return False
        self._skip(start)
        return True

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]


def _fields(payload: bytes) -> tuple[Field, ...] | None:
    """Return the fields of a payload; None if they do not fill it exactly."""
    found = []
    while payload:
        length = payload[0]
        if not 2 <= length <= len(payload):
            return None
        found.append(Field(payload[1], payload[2:length]))
        payload = payload[length:]
    return tuple(found)
