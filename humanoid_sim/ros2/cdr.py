"""ROS 2's wire format: little-endian CDR (OMG CORBA 3.3 part 2, section 9.3), by the definitions of the messages.

A message is a 4-byte encapsulation header and a body. Every number is aligned to its own size, counted from the start
of the body. A string is its length with the final NUL, the bytes, and the NUL; a sequence is its count and its
elements; an empty sequence has no padding after its count.

In Python a message is its values in the order of the definition. Neighbouring numbers, those of nested messages and of
arrays of fixed length included, are one tuple; a sequence of numbers is an array of shape (n,), one of messages a list.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np

from humanoid_sim.ros2.definitions import message_fields

ENCAPSULATION = b"\x00\x01\x00\x00"  # header of a plain little-endian CDR body
_CODES = {
    "bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d"
}  # fmt: skip
_COUNT = struct.Struct("<I")


class CdrError(ValueError):
    """Bytes that are no message of the expected layout."""


class _Part(NamedTuple):
    """Part of a message: what kind of value, and what it takes to lay it out."""

    kind: Literal["numbers", "array", "text", "texts", "messages"]
    layout: Any = None  # numbers: a struct for each offset modulo 8; array: its dtype; messages: the parts of each


@cache
def _parts(schema: str) -> tuple[_Part, ...]:
    parts, codes = [], ""
    for kind, length in _leaves(schema):
        if kind in _CODES and length != 0:
            codes += _CODES[kind] * (length or 1)
            continue
        if codes:
            parts.append(_numbers(codes))
            codes = ""
        if kind in _CODES:
            parts.append(_Part("array", np.dtype(f"<{_CODES[kind]}")))
        elif kind == "string":
            parts.append(_Part("text" if length is None else "texts"))
        else:
            parts.append(_Part("messages", _parts(kind)))
    return (*parts, _numbers(codes)) if codes else tuple(parts)


def _leaves(schema: str) -> Iterator[tuple[str, int | None]]:
    """Yield type and length of the fields of a message, with those of nested messages in their place."""
    for _, kind, length in message_fields(schema):
        if length is None and "/" in kind:
            yield from _leaves(kind)
        else:
            yield kind, length


def _numbers(codes: str) -> _Part:
    layouts = []
    for start in range(8):
        layout, offset = "<", start
        for code in codes:
            size = struct.calcsize(f"<{code}")
            layout += f"{-offset % size}x{code}"
            offset += -offset % size + size
        layouts.append(struct.Struct(layout))
    return _Part("numbers", layouts)


def _write(body: bytearray, parts: Iterable[_Part], values: Iterable[Any]) -> None:
    for (kind, layout), value in zip(parts, values, strict=True):
        if kind == "numbers":
            body += layout[len(body) % 8].pack(*value)
        elif kind == "text":
            _write_text(body, value)
        elif kind == "texts":
            body += _texts(tuple(value), len(body) % 8)
        else:
            _write_count(body, len(value))
            if kind == "array" and len(value):
                body += bytes(-len(body) % layout.itemsize) + np.asarray(value, layout).tobytes()
            elif kind == "messages":
                for item in value:
                    _write(body, layout, item)


@lru_cache(maxsize=256)  # the names of joints are in most messages
def _texts(texts: tuple[str, ...], offset: int) -> bytes:
    """Return a sequence of strings that begins at a body's offset, modulo 8."""
    body = bytearray(offset)
    _write_count(body, len(texts))
    for text in texts:
        _write_text(body, text)
    return bytes(body[offset:])


def _write_count(body: bytearray, count: int) -> None:
    body += bytes(-len(body) % 4) + _COUNT.pack(count)


def _write_text(body: bytearray, text: str) -> None:
    data = text.encode("utf-8", "surrogatepass") + b"\x00"
    _write_count(body, len(data))
    body += data


def _read(body: bytes, parts: Iterable[_Part], start: int) -> tuple[list[Any], int]:
    """Return the values that begin at an offset, and where they end."""
    values: list[Any] = []
    value: Any
    for kind, layout in parts:
        if kind == "numbers":
            value = layout[start % 8].unpack_from(body, start)
            start += layout[start % 8].size
        elif kind == "text":
            value, start = _read_text(body, start)
        else:
            count, start = _read_count(body, start)
            if kind == "array":
                start += -start % layout.itemsize if count else 0
                value = np.frombuffer(body, layout, count, start) if count else np.zeros(0, layout)
                start += count * layout.itemsize
            else:
                value = []
                for _ in range(count):
                    item, start = _read_text(body, start) if kind == "texts" else _read(body, layout, start)
                    value.append(item)
        values.append(value)
    return values, start


def _read_count(body: bytes, start: int) -> tuple[int, int]:
    start += -start % 4
    (count,) = _COUNT.unpack_from(body, start)
    return count, start + 4


def _read_text(body: bytes, start: int) -> tuple[str, int]:
    length, start = _read_count(body, start)
    text, end = body[start : start + length], start + length
    if end > len(body) or not text.endswith(b"\x00"):
        raise CdrError(f"a string of {length} bytes in {len(body) - start} bytes, or without its final NUL")
    return text[:-1].decode("utf-8", "surrogatepass"), end


def encode(schema: str, *values: Any) -> bytes:
    """Return the message of a type (`package/msg/Type`) with these values, as the module says."""
    return ENCAPSULATION + encode_fields(schema, 0, *values)


def encode_fields(schema: str, first: int, *values: Any) -> bytes:
    """Return the bytes of some of a message's values, the `first`-th and on, for an offset that is a multiple of 8."""
    body = bytearray()
    _write(body, _parts(schema)[first : first + len(values)], values)
    return bytes(body)


def decode(schema: str, message: bytes) -> list[Any]:
    """Return the values of a message; arrays are read-only. Raises `CdrError` if it is not one of this type."""
    if message[:4] != ENCAPSULATION:
        raise CdrError(f"encapsulation header is {message[:4].hex(' ') or 'missing'}, expected 00 01 00 00")
    body = message[4:]
    try:
        values, end = _read(body, _parts(schema), 0)
    except (struct.error, ValueError) as error:  # it ends too early, or a text is not UTF-8
        raise CdrError(str(error)) from None
    if len(body) - end > 3:  # some writers pad
        raise CdrError(f"{len(body) - end} bytes left after the last field")
    return values
