"""When do two sources say the same?"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from humanoid_sim.controllers.terms import TERM_KINDS
from humanoid_sim.policy.readers.partial import Given

__all__ = ["agreed", "kind_of"]

_EQUAL = 1e-9
"""Relative. What is left of a number that was written with nine digits, or went through a float32 and back, does not
count; gains and scales that mean something else differ by far more."""
_EXPORTERS_DECIMALS = 3
"""From this many decimals on, a copy that equals the other number rounded to them is a rounded copy."""


def agreed(field: str, first: Given, second: Given) -> Given | None:
    """The value that both sources stand for; None if they contradict each other.

    Numbers agree if they are equal, or if one is the other rounded to the digits with which its source writes it. Then
    the more precise one is taken, and its source says so. A copy of fewer than three decimals counts as rounded only if
    it still has two digits that mean something: 40.2 for 40.179, but not 0.2 for 0.25.
    """
    if field in _BY_MEANING:
        meaning = _BY_MEANING[field]
        return first if meaning(first.value) == meaning(second.value) else None
    if _is_numeric(first.value) and _is_numeric(second.value):
        return _agreed_numbers(first, second)
    return first if _same(first.value, second.value) else None


def _agreed_numbers(first: Given, second: Given) -> Given | None:
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    if a.shape != b.shape and a.size > 1 and b.size > 1:
        return None
    longer = first if a.size >= b.size else second
    if np.allclose(a, b, rtol=_EQUAL, atol=0.0):
        return longer
    coarse, fine = sorted((first, second), key=_decimals)
    if _is_rounded(coarse, fine):
        value = np.broadcast_to(fine.value, np.broadcast_shapes(a.shape, b.shape))
        return Given(value if value.ndim else float(value), f"{fine.source} ({coarse.source} has it rounded)")
    return None


def kind_of(name: str) -> str:
    """What a term means: exporters give the same term different names."""
    kind = TERM_KINDS.get(name, name)
    return "velocity_command" if kind == "command" else kind


def _kinds(names: tuple[str, ...]) -> list[str]:
    return [kind_of(name) for name in names]


def _commands(names: tuple[str, ...]) -> list[str]:
    return sorted({"motion" if name == "motion" else "velocity" for name in names})


_BY_MEANING = {"observation": _kinds, "command_names": _commands}
"""Fields whose names may differ between exporters, and what has to be the same."""


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
