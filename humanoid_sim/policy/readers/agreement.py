"""Agreement of two sources, in whatever words and digits; and where there is none, the difference."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

import numpy as np

from humanoid_sim.controllers.term_kinds import term_kind
from humanoid_sim.policy.readers.partial import Given, PartialContract
from humanoid_sim.policy.readers.values import shown

_EQUAL = 1e-9
"""Relative. What is left of a number that was written with nine digits, or went through a float32 and back, does not
count; gains and scales that mean something else differ by far more."""
_EXPORTERS_DECIMALS = 3
"""From this many decimals on, a copy that equals the other number rounded to them is a rounded copy."""


@dataclass(frozen=True, slots=True)
class Kinds:
    """Meaning of the names of terms, as all sources together say."""

    stated: Mapping[str, str] = field(default_factory=dict)
    """By the name of the term, its option `kind`."""
    commands: tuple[str, ...] = ()
    """The contract's `command_names`."""

    @classmethod
    def told(cls, partials: Iterable[PartialContract]) -> Kinds:
        """Return what the sources say; of those that contradict each other the one that overrides, or else the last."""
        stated: dict[str, str] = {}
        commands: tuple[str, ...] = ()
        for partial in sorted(partials, key=lambda partial: partial.overrides):
            stated |= {name: options["kind"].value for name, options in partial.terms.items() if "kind" in options}
            if "command_names" in partial.fields:
                commands = partial.fields["command_names"].value
        return cls(stated, commands)

    def of(self, name: str) -> str:
        """Name of the kind of a term."""
        return term_kind(self.stated.get(name, name), self.commands).name


_BY_NAME = Kinds()


def agreed(field: str, first: Given, second: Given, kinds: Kinds = _BY_NAME) -> Given | None:
    """Return the value that both sources stand for; None if they contradict each other.

    Numbers agree if they are equal, or if one is the other rounded to the digits with which its source writes it. Then
    the more precise one is taken, and its source says so. A copy of fewer than three decimals counts as rounded only if
    it still has two significant digits: 40.2 for 40.179, but not 0.2 for 0.25.
    """
    if field == "observation":
        return first if list(map(kinds.of, first.value)) == list(map(kinds.of, second.value)) else None
    if field == "command_names":
        return first if _commands(first.value) == _commands(second.value) else None
    if _is_numeric(first.value) and _is_numeric(second.value):
        return _agreed_numbers(first, second)
    return first if _same(first.value, second.value) else None


def _agreed_numbers(first: Given, second: Given) -> Given | None:
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    if a.shape != b.shape and 1 not in (a.size, b.size):
        return None
    longer = first if a.size >= b.size else second
    if np.allclose(a, b, rtol=_EQUAL, atol=0.0):
        return longer
    coarse, fine = sorted((first, second), key=_decimals)
    if _is_rounded(coarse, fine):
        value = np.broadcast_to(fine.value, np.broadcast_shapes(a.shape, b.shape))
        return Given(value if value.ndim else float(value), f"{fine.source} ({coarse.source} has it rounded)")
    return None


def _commands(names: tuple[str, ...]) -> list[str]:
    return sorted({"motion" if name == "motion" else "velocity" for name in names})


def _is_numeric(value: Any) -> bool:
    return (isinstance(value, int | float) and not isinstance(value, bool)) or (
        isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    )


def _same(a: Any, b: Any) -> bool:
    if is_dataclass(a) and is_dataclass(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_same(x, y) for x, y in zip(a, b, strict=True))
    if _is_numeric(a) and _is_numeric(b):
        return np.shape(a) == np.shape(b) and bool(np.allclose(a, b, rtol=_EQUAL, atol=0.0))
    return type(a) is type(b) and bool(a == b)


def _is_rounded(coarse: Given, fine: Given) -> bool:
    values = np.atleast_1d(np.asarray(coarse.value, dtype=np.float64))
    decimals = _decimals(coarse)
    if decimals < 1 or not np.isfinite(values).all():
        return False
    if decimals < _EXPORTERS_DECIMALS and np.abs(values).max() * 10**decimals < 10:
        return False
    # The place after the last one decides by its half; a float's own error must not.
    return bool((np.abs(values - fine.value) <= 0.5 * 10.0**-decimals + 1e-12).all())


def _decimals(given: Given) -> int:
    if given.decimals is not None:
        return given.decimals
    values = np.asarray(given.value, dtype=np.float64).ravel()
    texts = [np.format_float_positional(value, trim="-") for value in values if np.isfinite(value)] or [""]
    return max(len(text.partition(".")[2]) for text in texts)


def contradiction(name: str, first: Given, second: Given, kinds: Kinds = _BY_NAME) -> str:
    """Return what two sources say of a field, as far as it differs, and what to do about it."""
    a, b = first.value, second.value
    if _are_names(a) and _are_names(b):
        what = _different_names(first, second, kinds.of if name == "observation" else str)
    else:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape and a.ndim:
            place = next(tuple(map(int, i)) for i in np.argwhere(~np.isclose(a, b, rtol=_EQUAL, atol=0.0)))
            name += "".join(f"[{i}]" for i in place)
            a, b = float(a[place]), float(b[place])
        what = f"{shown(a)} in {first.source} contradicts {shown(b)} in {second.source}"
    return (
        f"{name}: {what}; if one of them is wrong, write the right one under override: in x.contract.yaml, "
        "or leave out a source that is wrong as a whole with ignore:"
    )


def _are_names(value: Any) -> bool:
    return isinstance(value, tuple) and all(isinstance(item, str) for item in value)


def _different_names(first: Given, second: Given, meaning: Callable[[str], str]) -> str:
    """Give the names that only one of two lists has; where both have the same, the first place at which they differ."""
    sides = ((first, second), (second, first))
    parts = [
        f"{', '.join(surplus)} only in {one.source}"
        for one, other in sides
        if (surplus := _surplus(one.value, other.value, meaning))
    ]
    if parts:
        return "; ".join(parts)
    place = next(i for i, (a, b) in enumerate(zip(first.value, second.value, strict=True)) if meaning(a) != meaning(b))
    return (
        f"the order differs: at place {place} {first.value[place]} in {first.source} "
        f"contradicts {second.value[place]} in {second.source}"
    )


def _surplus(names: Sequence[str], others: Sequence[str], meaning: Callable[[str], str]) -> list[str]:
    left = list(map(meaning, others))
    surplus = []
    for name in names:
        if meaning(name) in left:
            left.remove(meaning(name))
        else:
            surplus.append(name)
    return surplus
