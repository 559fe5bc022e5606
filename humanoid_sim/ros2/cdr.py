"""ROS 2's wire format: little-endian CDR (OMG CORBA 3.3 part 2, section 9.3), by the definitions of the messages.

A message is a 4-byte encapsulation header and a body. Every number is aligned to its own size, counted from the start
of the body. A string is its length with the final NUL, the bytes, and the NUL; a sequence is its count and its
elements; an empty sequence has no padding after its count.

In Python a message is its values in the order of the definition. Neighbouring numbers, those of nested messages and of
arrays of fixed length included, are one tuple; a sequence of numbers is an array of shape (n,), one of messages a list.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, lru_cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from humanoid_sim.ros2.definitions import MessageField, message_fields

ENCAPSULATION = b"\x00\x01\x00\x00"  # header of a plain little-endian CDR body
_CODES = {
    "bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d"
}  # fmt: skip
_COUNT = struct.Struct("<I")


class CdrError(ValueError):
    """Bytes that are no message of the expected layout."""


class _Part(Protocol):
    """Part of a message."""

    def write(self, body: bytearray, value: Any) -> None:
        """Append a value to the body."""

    def read(self, body: bytes, start: int) -> tuple[Any, int]:
        """Return the value that begins at an offset, and where it ends."""


class _Numbers:
    def __init__(self, codes: str) -> None:
        self._layouts = [_padded(codes, start) for start in range(8)]

    def write(self, body: bytearray, value: Iterable[float]) -> None:
        body += self._layouts[len(body) % 8].pack(*value)

    def read(self, body: bytes, start: int) -> tuple[tuple[Any, ...], int]:
        layout = self._layouts[start % 8]
        return layout.unpack_from(body, start), start + layout.size


def _padded(codes: str, start: int) -> struct.Struct:
    """Return a struct of numbers with CDR's padding before each, for a body offset of `start` modulo 8."""
    parts, offset = ["<"], start
    for code in codes:
        size = struct.calcsize(f"<{code}")
        padding = -offset % size
        parts.append(f"{padding}x{code}")
        offset += padding + size
    return struct.Struct("".join(parts))


class _Array:
    def __init__(self, code: str) -> None:
        self._dtype = np.dtype(f"<{code}")

    def write(self, body: bytearray, value: Sequence[float] | npt.NDArray[Any]) -> None:
        body += _count(len(value), len(body) % 8, self._dtype.itemsize)
        if len(value):
            body += np.asarray(value, self._dtype).tobytes()

    def read(self, body: bytes, start: int) -> tuple[npt.NDArray[Any], int]:
        count, start = _read_count(body, start)
        if not count:
            return np.zeros(0, self._dtype), start
        start += -start % self._dtype.itemsize
        return np.frombuffer(body, self._dtype, count, start), start + count * self._dtype.itemsize


class _Text:
    def write(self, body: bytearray, value: str) -> None:
        body += _encoded_text(value, len(body) % 4)

    def read(self, body: bytes, start: int) -> tuple[str, int]:
        length, start = _read_count(body, start)
        text, end = body[start : start + length], start + length
        if end > len(body) or not text.endswith(b"\x00"):
            raise CdrError(f"a string of {length} bytes in {len(body) - start} bytes, or without its final NUL")
        return text[:-1].decode("utf-8", "surrogatepass"), end


@lru_cache(maxsize=1024)
def _encoded_text(text: str, offset: int) -> bytes:
    data = text.encode("utf-8", "surrogatepass") + b"\x00"
    return _count(len(data), offset, 1) + data


class _Texts:
    def write(self, body: bytearray, value: Iterable[str]) -> None:
        body += _encoded_texts(tuple(value), len(body) % 4)

    def read(self, body: bytes, start: int) -> tuple[list[str], int]:
        return _Sequence(_Text()).read(body, start)


@lru_cache(maxsize=1024)  # the names of joints are in most messages
def _encoded_texts(texts: tuple[str, ...], offset: int) -> bytes:
    data = bytes(offset)
    data += _count(len(texts), offset, 1)
    for text in texts:
        data += _encoded_text(text, len(data) % 4)
    return data[offset:]


@lru_cache(maxsize=1024)
def _count(count: int, offset: int, size: int) -> bytes:
    """Return the count of elements of `size` bytes, for a body offset modulo 8, with the padding around it."""
    padding = -offset % 4
    gap = -(offset + padding + 4) % size if count else 0
    return bytes(padding) + _COUNT.pack(count) + bytes(gap)


def _read_count(body: bytes, start: int) -> tuple[int, int]:
    start += -start % 4
    (count,) = _COUNT.unpack_from(body, start)
    return count, start + 4


class _Sequence:
    def __init__(self, element: _Part) -> None:
        self._element = element

    def write(self, body: bytearray, value: Sequence[Any]) -> None:
        body += _count(len(value), len(body) % 8, 1)
        for item in value:
            self._element.write(body, item)

    def read(self, body: bytes, start: int) -> tuple[list[Any], int]:
        count, start = _read_count(body, start)
        items = []
        for _ in range(count):
            item, start = self._element.read(body, start)
            items.append(item)
        return items, start


class _Message:
    def __init__(self, parts: list[_Part]) -> None:
        self.parts = parts

    def write(self, body: bytearray, value: Iterable[Any]) -> None:
        for part, item in zip(self.parts, value, strict=True):
            part.write(body, item)

    def read(self, body: bytes, start: int) -> tuple[list[Any], int]:
        items = []
        for part in self.parts:
            item, start = part.read(body, start)
            items.append(item)
        return items, start


@cache
def _message(schema: str) -> _Message:
    parts: list[_Part] = []
    codes = ""
    for field in _leaves(schema):
        if field.length != 0 and field.kind in _CODES:
            codes += _CODES[field.kind] * (field.length or 1)
            continue
        if codes:
            parts.append(_Numbers(codes))
            codes = ""
        parts.append(_part(field))
    return _Message([*parts, _Numbers(codes)] if codes else parts)


def _leaves(schema: str) -> Iterator[MessageField]:
    """Yield the fields of a message, with those of nested messages in their place."""
    for field in message_fields(schema):
        if field.length is None and "/" in field.kind:
            yield from _leaves(field.kind)
        else:
            yield field


def _part(field: MessageField) -> _Part:
    if field.kind in _CODES:
        return _Array(_CODES[field.kind])
    if field.kind == "string":
        return _Text() if field.length is None else _Texts()
    return _Sequence(_message(field.kind))


def encode(schema: str, *values: Any) -> bytes:
    """Return the message of a type (`package/msg/Type`) with these values, as the module says."""
    body = bytearray()
    _message(schema).write(body, values)
    return ENCAPSULATION + body


def encode_fields(schema: str, first: int, *values: Any) -> bytes:
    """Return the bytes of some of a message's values, the `first`-th and on, for an offset that is a multiple of 8."""
    body = bytearray()
    for part, value in zip(_message(schema).parts[first:], values, strict=False):
        part.write(body, value)
    return bytes(body)


def decode(schema: str, message: bytes) -> list[Any]:
    """Return the values of a message; arrays are read-only. Raises `CdrError` if it is not one of this type."""
    if message[:4] != ENCAPSULATION:
        raise CdrError(f"encapsulation header is {message[:4].hex(' ') or 'missing'}, expected 00 01 00 00")
    body = message[4:]
    try:
        values, end = _message(schema).read(body, 0)
    except (struct.error, ValueError) as error:  # it ends too early, or a text is not UTF-8
        raise CdrError(str(error)) from None
    if len(body) - end > 3:  # some writers pad
        raise CdrError(f"{len(body) - end} bytes left after the last field")
    return values
