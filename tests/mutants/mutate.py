"""Mutations: of bytes, of texts' numbers, and of documents that are trees of mappings and lists."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

__all__ = ["ODD", "mutated_bytes", "mutated_document", "mutated_text", "odd", "written"]

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_SIZES = (0, 1, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 40, (1 << 64) - 1)
_TEXTS = (b"0", b"-1", b"1e308", b"nan", b"inf", b"1e8", b"99999999999", b"1e-320", b"x", b"")


def _nested(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 0.5, 10**8, 2**63, 10**400, 1e308, -1e308, 1e-320, float("nan"), float("inf"),
    "", "x", "nan", "../..", "a\nb", "\0", "é\u202e", "y" * 100_000,
    [], {}, {"x": 1}, [0.0], [1.0] * 1000, _nested(90), _nested(900),
)  # fmt: skip
"""What stands where something else is expected."""


def odd(rng: np.random.Generator) -> Any:
    """One of `ODD`."""
    return ODD[int(rng.integers(len(ODD)))]


def mutated_bytes(data: bytes, rng: np.random.Generator) -> bytes:
    """Up to four places changed: flipped, overwritten, left out, doubled, moved, cut off, or a number replaced."""
    result = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        size = len(result)
        if not size:
            break
        start, length = int(rng.integers(size)), int(rng.integers(1, 33))
        match int(rng.integers(9)):
            case 0:
                result[start] ^= 1 << int(rng.integers(8))
            case 1:
                result[start : start + length] = rng.bytes(length)
            case 2:
                del result[start : start + length]
            case 3:
                result[start:start] = result[start : start + length]
            case 4:
                del result[start:]
            case 5:
                width = int(rng.choice([1, 2, 4, 8]))
                result[start : start + width] = (_pick(_SIZES, rng) & ((1 << 8 * width) - 1)).to_bytes(width, "little")
            case 6:
                result[start : start + length] = bytes(length)
            case 7:
                other = int(rng.integers(size))
                result[start : start + length] = result[other : other + length]
            case _:
                result = bytearray(mutated_text(bytes(result), rng))
    return bytes(result)


def mutated_text(data: bytes, rng: np.random.Generator) -> bytes:
    """One number in a text replaced."""
    start = int(rng.integers(len(data) + 1))
    found = _NUMBER.search(data, start) or _NUMBER.search(data)
    return data if found is None else data[: found.start()] + _pick(_TEXTS, rng) + data[found.end() :]


def mutated_document(document: Any, rng: np.random.Generator) -> Any:
    """One or two of a document's values replaced, left out, exchanged, or given another name."""
    for _ in range(int(rng.integers(1, 3))):
        places = list(_places(document))
        if not places:
            return odd(rng)
        document = _changed(document, _pick(places, rng), rng, _pick(places, rng))
    return document


def written(document: Any, rng: np.random.Generator) -> bytes:
    """As JSON, which is YAML too; now and then with something in front of it or behind it."""
    try:
        text = json.dumps(document)
    except (ValueError, RecursionError):
        text = "[" * 5000
    text = text.replace("NaN", ".nan").replace("Infinity", ".inf") if rng.random() < 0.5 else text
    return text.encode("utf-8", "surrogatepass")


def _places(document: Any, prefix: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = document.items() if isinstance(document, Mapping) else enumerate(document)
    for key, value in items:
        yield (*prefix, key)
        if isinstance(value, dict | list) and value and len(prefix) < 8:
            yield from _places(value, (*prefix, key))


def _at(document: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        document = document[key]
    return document


def _changed(document: Any, place: tuple[Any, ...], rng: np.random.Generator, other: tuple[Any, ...]) -> Any:
    copy: Any = dict(document) if isinstance(document, Mapping) else list(document)
    key = place[0]
    if len(place) > 1:
        copy[key] = _changed(copy[key], place[1:], rng, other)
        return copy
    match int(rng.integers(6)):
        case 0:
            del copy[key]
        case 1 if isinstance(copy, dict):
            copy[str(odd(rng))[:50]] = copy.pop(key)
        case 2 if isinstance(copy, list):
            copy.insert(key, copy[key])
        case 3:
            with_other = document
            try:
                copy[key] = _at(with_other, other)
            except (KeyError, IndexError, TypeError):
                copy[key] = odd(rng)
        case _:
            copy[key] = odd(rng)
    return copy


def _pick(items: Any, rng: np.random.Generator) -> Any:
    return items[int(rng.integers(len(items)))]
