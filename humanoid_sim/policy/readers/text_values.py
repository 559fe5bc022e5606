"""Values as text: lists in a model's metadata read, and anything of a stranger's shown in a message of one line."""

from __future__ import annotations

from typing import Any

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.partial import Given

__all__ = ["cut", "integers", "names", "number", "number_lists", "numbers", "one_line", "shown"]


def names(text: str) -> tuple[str, ...]:
    """The items without the space around them; empty text is an empty list."""
    return tuple(_items(text))


def number(key: str, text: str, where: str) -> float:
    """One number.

    Raises:
        InputError: naming `where`, the key and the text, if it is none.
    """
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where}: {key} is {text!r}, expected one number") from None


def numbers(key: str, text: str, where: str, source: str) -> Given:
    """At least one number, and how many decimals they have; a single one stands for every joint.

    Raises:
        InputError: as `number`.
    """
    items = _items(text)
    try:
        values = [float(item) for item in items]
    except ValueError:
        raise InputError(f"{where}: {key} is {text!r}, expected numbers separated by commas") from None
    if not values:
        raise InputError(f"{where}: {key} is empty, expected numbers separated by commas")
    # In scientific notation the digits behind the point do not tell the last place: then the values themselves do.
    plain = all("e" not in item.lower() for item in items)
    decimals = max(len(item.partition(".")[2]) for item in items) if plain else None
    return Given(np.array(values[0] if len(values) == 1 else values), source, decimals)


def integers(key: str, text: str, where: str) -> tuple[int, ...]:
    """Whole numbers.

    Raises:
        InputError: as `number`.
    """
    try:
        return tuple(int(item) for item in _items(text))
    except ValueError:
        raise InputError(f"{where}: {key} is {text!r}, expected integers separated by commas") from None


def number_lists(key: str, text: str, where: str) -> list[list[float]]:
    """Numbers in groups: commas between the groups, semicolons within one.

    Raises:
        InputError: as `number`.
    """
    try:
        return [[float(value) for value in item.split(";")] for item in _items(text)]
    except ValueError:
        accepted = "numbers separated by commas, and by semicolons within an entry"
        raise InputError(f"{where}: {key} is {text!r}, expected {accepted}") from None


def _items(text: str) -> list[str]:
    text = text.strip()
    return [item.strip() for item in text.split(",")] if text else []


def shown(value: Any, width: int = 60) -> str:
    """A value as a person would write it, in at most `width` characters."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        text = f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return cut(text, width)


def cut(text: str, width: int = 80) -> str:
    """The text in at most `width` characters."""
    return text if len(text) <= width else text[: width - 3] + "..."


def one_line(text: str) -> str:
    """The text without line breaks, which names in somebody's file may well have."""
    return " ".join(text.split())
