"""Values as sources write them: comma-separated text, plain JSON and YAML; and as messages of one line show them.

Text that is malformed is an `InputError`, which names `where`, the key and the text.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import FORMS
from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.partial import Given


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
