"""ROS 2's wire format: little-endian CDR (OMG CORBA 3.3 part 2, section 9.3; `CDR_LE` of DDS-XTypes 1.3, 7.6.3.1).

A message is a 4-byte encapsulation header and a body. Every primitive is aligned to its own size, counted from the
start of the body. A string is its length with the final NUL, the bytes, and the NUL; a sequence is its count and its
elements; an empty sequence has no padding after its count.
"""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

ENCAPSULATION = b"\x00\x01\x00\x00"  # header of a plain little-endian CDR body
_SIZES = {"?": 1, "B": 1, "b": 1, "H": 2, "h": 2, "I": 4, "i": 4, "f": 4, "Q": 8, "q": 8, "d": 8}


class CdrError(ValueError):
    """Bytes that are no message of the expected layout."""


@cache
def layout(codes: str, start: int = 0) -> struct.Struct:
    """Return a struct of primitives with CDR's padding before each, for a body offset of `start` modulo 8.

    `codes` has one `struct` letter per primitive (`?BbHhIifQqd`).
    """
    parts, offset = ["<"], start
    for code in codes:
        padding = -offset % _SIZES[code]
        parts.append(f"{padding}x{code}")
        offset += padding + _SIZES[code]
    return struct.Struct("".join(parts))


class CdrWriter:
    """Builds a message, or a stretch of one, field by field in the order of its definition.

    A stretch is placed at an offset that is a multiple of 8; `skip` bytes (at most 7) then stand for what precedes it.
    """

    __slots__ = ("_body", "_skip")

    def __init__(self, skip: int = 0) -> None:
        self._body = bytearray(skip)
        self._skip = skip

    def pack(self, codes: str, *values: Any) -> None:
        """Append primitives; `codes` has one `struct` letter for each."""
        self._body += layout(codes, len(self._body) & 7).pack(*values)

    def string(self, text: str) -> None:
        """Append a string. Lone surrogates are kept, although no other reader will like them."""
        data = text.encode("utf-8", "surrogatepass")
        self.pack("I", len(data) + 1)
        self._body += data + b"\x00"

    def strings(self, texts: tuple[str, ...] | list[str]) -> None:
        """Append a sequence of strings."""
        self.pack("I", len(texts))
        for text in texts:
            self.string(text)

    def array(self, values: npt.NDArray[Any]) -> None:
        """Append a sequence of numbers of the array's own type, flattened row by row."""
        self.pack("I", values.size)
        if values.size:
            self.fixed_array(values)

    def fixed_array(self, values: npt.NDArray[Any]) -> None:
        """Append an array whose length is part of the definition: no count."""
        self._body += b"\x00" * (-len(self._body) % values.itemsize)
        self._body += values.tobytes()

    def append(self, stretch: bytes) -> None:
        """Append fields that were encoded elsewhere for this offset."""
        self._body += stretch

    def body(self) -> bytes:
        """Return the fields so far, without the encapsulation header and without what was skipped."""
        return bytes(self._body[self._skip :])

    def message(self) -> bytes:
        """Return the whole message."""
        return ENCAPSULATION + self._body


class CdrReader:
    """Takes one message apart, field by field. Every method raises `CdrError` at the end of the data."""

    __slots__ = ("_data", "_offset")

    def __init__(self, message: bytes | memoryview) -> None:
        if bytes(message[:4]) != ENCAPSULATION:
            raise CdrError(f"encapsulation header is {bytes(message[:4]).hex(' ') or 'missing'}, expected 00 01 00 00")
        self._data = memoryview(message)[4:]
        self._offset = 0

    @property
    def remaining(self) -> int:
        """Bytes not read yet."""
        return len(self._data) - self._offset

    def unpack(self, codes: str) -> tuple[Any, ...]:
        """Read primitives; `codes` has one `struct` letter for each."""
        fields = layout(codes, self._offset & 7)
        try:
            values = fields.unpack_from(self._data, self._offset)
        except struct.error:
            raise CdrError(f"ends at body byte {len(self._data)}, inside a field") from None
        self._offset += fields.size
        return values

    def count(self, smallest: int = 1) -> int:
        """Read a sequence's count, of elements of at least `smallest` bytes."""
        (count,) = self.unpack("I")
        if count * smallest > self.remaining:
            raise CdrError(f"a sequence of {count} elements in {self.remaining} bytes")
        return int(count)

    def string(self) -> str:
        """Read a string."""
        (length,) = self.unpack("I")
        if not 0 < length <= self.remaining:
            raise CdrError(f"a string of {length} bytes in {self.remaining} bytes")
        data = bytes(self._data[self._offset : self._offset + length])
        self._offset += length
        if data[-1] != 0:
            raise CdrError("a string without its final NUL")
        try:
            return data[:-1].decode("utf-8", "surrogatepass")
        except UnicodeDecodeError as error:
            raise CdrError(f"a string that is not UTF-8 ({error.reason})") from None

    def strings(self) -> tuple[str, ...]:
        """Read a sequence of strings."""
        return tuple(self.string() for _ in range(self.count(5)))

    def array(self, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        """Read a sequence of numbers. Shape (count,), a read-only view of the message."""
        count = self.count(np.dtype(dtype).itemsize)
        return self.fixed_array(dtype, count) if count else np.zeros(0, dtype)

    def fixed_array(self, dtype: npt.DTypeLike, count: int) -> npt.NDArray[Any]:
        """Read an array whose length is part of the definition. Shape (count,), a view of the message."""
        kind = np.dtype(dtype)
        start = self._offset + -self._offset % kind.itemsize
        end = start + count * kind.itemsize
        if end > len(self._data):
            raise CdrError(f"an array of {count} numbers in {self.remaining} bytes")
        self._offset = end
        array: npt.NDArray[Any] = np.frombuffer(self._data[start:end], dtype=kind)
        return array

    def finish(self) -> None:
        """Check that nothing is left but up to three bytes of padding, which some writers add."""
        if self.remaining > 3:
            raise CdrError(f"{self.remaining} bytes left after the last field")
