"""Findings of checks: a severity, a field, and one line for all the joints that it concerns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""The worst first. An error keeps the policy from running as it was meant to; a warning is worth a look."""
_LISTED = 3  # joints that a message names before it counts them


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found."""

    severity: Severity
    field: str
    """Field of the contract, or `model`, `golden vectors`, `robot`."""
    message: str
    """What was found, what was expected, and for which joints."""
    joints: tuple[str, ...] = ()
    """All of them."""

    def __str__(self) -> str:
        return f"{self.field}: {self.message}"


def joint_list(joints: Sequence[str] | Mapping[str, str], count: int = 0) -> str:
    """Return joints for a message, each with its text if it has one: `a (1), b (2), c (3) and 12 more`."""
    if not isinstance(joints, Mapping) and len(joints) == count > _LISTED:
        return f"all {count} joints"
    shown = [f"{name} ({text})" for name, text in joints.items()] if isinstance(joints, Mapping) else list(joints)
    more = len(shown) - _LISTED
    return ", ".join(shown) if more <= 1 else f"{', '.join(shown[:_LISTED])} and {more} more"


def on_joints(
    severity: Severity,
    field: str,
    message: str,
    joints: Sequence[str] | Mapping[str, str],
    remark: str = "",
    count: int = 0,
) -> Iterator[Finding]:
    """Yield one finding for all the joints, if there are any; `count`: how many there are altogether."""
    if joints:
        yield Finding(severity, field, f"{message} {joint_list(joints, count)}{remark}", tuple(joints))
