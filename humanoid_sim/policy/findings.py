"""Findings of checks, and contracts, values and joints in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from humanoid_sim.names import list_joints

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""The worst first. An error keeps the policy from running as it was meant to; a warning is worth a look."""
_WIDTH = 60  # characters of a value
_VALUES = 6  # values of an array that are shown one by one


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found."""

    severity: Severity
    field: str  # of the contract, or `model`, `golden vectors`, `robot`
    message: str

    def __str__(self) -> str:
        return f"{self.field}: {self.message}"


def shown(value: Any) -> str:
    """Return a value as a person would write it, in at most 60 characters."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        value = f"values of {list_joints([str(name) for name in value])}"
    if isinstance(value, np.ndarray):
        if value.size > 1 and (value == value.flat[0]).all():
            return f"{value.flat[0]:g} everywhere"
        if value.size > _VALUES:
            return f"{value.min():g} to {value.max():g}, {value.size} values"
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        form = str if all(isinstance(item, str) for item in value) else repr  # a text among numbers shows as one
        text = f"[{', '.join(form(item) if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 3]}..."


def is_assumed(source: str) -> bool:
    """Return True if no source states a field, but a dialect implies it."""
    return source.startswith("assumed")


def assumptions(values: Mapping[str, Any], source: Mapping[str, str]) -> dict[str, str]:
    """Return the fields that no source states, with their values, by the dialect that implies them."""
    found: dict[str, list[str]] = {}
    for field, value, origin in contract_rows(values, source):
        if is_assumed(origin):
            found.setdefault(origin, []).append(f"{field} {value}")
    return {origin: "; ".join(texts) for origin, texts in found.items()}


def contract_rows(values: Mapping[str, Any], source: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return field, value and source, as in `Layer.values`; parts of a field, and options of terms, together."""
    parts: dict[tuple[str, str], list[str]] = {}
    for name, value in values.items():
        owner, _, part = name.rpartition(".")
        text = f"{part} {shown(value)}" if owner else in_words(value)
        parts.setdefault((owner or name, source[name]), []).append(text)
    rows: dict[tuple[str, str, str], list[str]] = {}
    for (owner, origin), texts in sorted(parts.items(), key=lambda item: item[0][0].startswith("observation.")):
        field, _, term = owner.partition(".")
        rows.setdefault(("terms" if term else field, ", ".join(texts), origin), []).append(term)
    return [
        (field, f"{text} of {', '.join(terms)}" if field == "terms" else text, origin)
        for (field, text, origin), terms in rows.items()
    ]


def in_words(value: Any) -> str:
    """Return a field's value, names too, in few words."""
    return list_joints([str(item) for item in value]) or "none" if isinstance(value, tuple) else shown(value) or "none"
