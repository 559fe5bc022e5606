"""Values as sources write them: comma-separated text, plain JSON and YAML; and as messages of one line show them.

Whatever is malformed is an `InputError`, which names the file, the key and the value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS
from humanoid_sim.errors import InputError, one_line
from humanoid_sim.policy.readers.partial import Given
from humanoid_sim.strict_yaml import read_yaml


def csv_field(field: str, key: str, text: str, where: str, source: str) -> Given:
    """Return a field of the contract from the text of a model's metadata."""
    match FORMS[field].kind:
        case "values":
            return numbers(key, text, where, source)
        case "number":
            return Given(number(key, text, where), source)
        case "steps":
            return Given(integers(key, text, where), source)
        case "names" | "structure":
            return Given(names(text), source)
    return Given(text.strip(), source)


def is_number(value: Any) -> bool:
    """Return whether a value of JSON or YAML is a number that a float holds; infinity is one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return not (isinstance(value, int) and abs(value) > 10**300) and not math.isnan(value)


def plain_numbers(value: Any) -> Any:
    """Return a number of JSON or YAML as a float, a list of them as an array of shape (k,); None for anything else."""
    if is_number(value):
        return float(value)
    if not isinstance(value, list) or not value or not all(map(is_number, value)):
        return None
    return np.array(value, dtype=np.float64)


def pair_of_numbers(value: Any) -> tuple[float, float] | None:
    """`[least, greatest]` of JSON or YAML; None for anything else."""
    if not isinstance(value, list) or len(value) != 2 or not all(map(is_number, value)):
        return None
    return float(value[0]), float(value[1])


class YamlDocument:
    """A trainer's YAML file, whose values are checked as they are taken; `where` is a value's place in the file."""

    def __init__(self, path: Path) -> None:
        """Read the file, a mapping."""
        self.path = path
        self.document = self.mapping(read_yaml(path), "the file")

    def wrong(self, where: str, value: Any, expected: str) -> InputError:
        """Return the refusal of a value."""
        return InputError(f"{self.path}: {one_line(f'{where} is {cut(str(value))}, expected {expected}')}")

    def mapping(self, value: Any, where: str) -> Mapping[str, Any]:
        """Return a mapping."""
        if not isinstance(value, dict):
            raise self.wrong(where, value, "a mapping")
        return value

    def items(self, value: Any, where: str) -> list[Any]:
        """Return a list that is not empty."""
        if not isinstance(value, list) or not value:
            raise self.wrong(where, value, "a list")
        return value

    def number(self, value: Any, where: str) -> float:
        """Return a number."""
        if not is_number(value):
            raise self.wrong(where, value, "a number")
        return float(value)

    def numbers(self, value: Any, where: str, size: int | None = None) -> Any:
        """Return a number, or an array of shape (k,): as many numbers as `size` says, or any."""
        found = plain_numbers(value)
        if found is None or (size is not None and np.shape(found) not in ((), (size,))):
            raise self.wrong(
                where, value, "a number, or a list of numbers" if size is None else f"a number, or {size} of them"
            )
        return found

    def pair(self, value: Any, where: str) -> tuple[float, float]:
        """Return `[least, greatest]`."""
        found = pair_of_numbers(value)
        if found is None:
            raise self.wrong(where, value, "[least, greatest]")
        return found

    def count(self, value: Any, where: str, least: int = 0) -> int:
        """Return a whole number."""
        if type(value) is not int or not least <= value <= 1000:
            raise self.wrong(where, value, f"a whole number >= {least}")
        return value

    def places(self, value: Any, where: str, accepted: str, below: int = 1000) -> tuple[int, ...]:
        """Return places of joints, none twice; `accepted` says in words which."""
        found = self.items(value, where)
        if not all(type(place) is int and 0 <= place < below for place in found) or len(set(found)) < len(found):
            raise self.wrong(where, value, accepted)
        return tuple(found)


def names(text: str) -> tuple[str, ...]:
    """Return the items without the space around them; empty text is an empty list."""
    text = text.strip()
    return tuple(item.strip() for item in text.split(",")) if text else ()


def number(key: str, text: str, where: str) -> float:
    """One number."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where}: {key} is {text!r}, expected one number") from None


def numbers(key: str, text: str, where: str, source: str) -> Given:
    """At least one number, and how many decimals they have; a single one stands for every joint."""
    items = names(text)
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
    """Read whole numbers; mjlab writes them with three decimals, as `2.000`."""
    try:
        values = [float(item) for item in names(text)]
    except ValueError:
        values = [math.nan]
    if not all(value.is_integer() for value in values):
        raise InputError(f"{where}: {key} is {text!r}, expected integers separated by commas")
    return tuple(map(int, values))


def flags(key: str, text: str, where: str) -> tuple[bool, ...]:
    """Read `True` and `False`, or 1 and 0 as `integers` are written."""
    words = {"True": "1", "False": "0"}
    try:
        found = integers(key, ",".join(words.get(item, item) for item in names(text)), where)
    except InputError:
        found = (-1,)
    if not {0, 1}.issuperset(found):
        raise InputError(f"{where}: {key} is {text!r}, expected True or False, separated by commas")
    return tuple(map(bool, found))


def number_lists(key: str, text: str, where: str) -> list[list[float]]:
    """Numbers in groups: commas between the groups, semicolons within one."""
    try:
        return [[float(value) for value in item.split(";")] for item in names(text)]
    except ValueError:
        accepted = "numbers separated by commas, and by semicolons within an entry"
        raise InputError(f"{where}: {key} is {text!r}, expected {accepted}") from None


def shown(value: Any, width: int = 60) -> str:
    """Return a value as a person would write it, in at most `width` characters."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        text = f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return cut(text, width)


def cut(text: str, width: int = 80) -> str:
    """Return the text in at most `width` characters."""
    return text if len(text) <= width else text[: width - 3] + "..."
