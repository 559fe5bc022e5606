"""Findings of checks, and values and joints as one line of a message shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""The worst first. An error keeps the policy from running as it was meant to; a warning is worth a look."""
_LISTED = 3  # joints that a message names before it counts them
_VALUES = 6  # values of an array that are shown one by one


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found."""

    severity: Severity
    field: str  # of the contract, or `model`, `golden vectors`, `robot`
    message: str

    def __str__(self) -> str:
        return f"{self.field}: {self.message}"


def list_joints(joints: Sequence[str] | Mapping[str, str], count: int = 0) -> str:
    """Return `a (1), b (2), c (3) and 12 more`; `all 29 joints` where `count`, the number of joints, are given."""
    if not isinstance(joints, Mapping) and len(joints) == count > 1:
        return f"all {count} joints"
    items = [f"{name} ({text})" for name, text in joints.items()] if isinstance(joints, Mapping) else list(joints)
    more = len(items) - _LISTED
    return ", ".join(items) if more <= 1 else f"{', '.join(items[:_LISTED])} and {more} more"


def shown(value: Any, width: int = 60) -> str:
    """Return a value as a person would write it, in at most `width` characters."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    if isinstance(value, np.ndarray):
        if value.size > 1 and (value == value.flat[0]).all():
            return f"{value.flat[0]:g} everywhere"
        if value.size > _VALUES:
            return f"{value.min():g} to {value.max():g}, {value.size} values"
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        text = f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."
