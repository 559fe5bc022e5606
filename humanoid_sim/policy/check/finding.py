"""What a check found: one line each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

__all__ = ["SEVERITIES", "Finding", "Severity", "sorted_findings"]

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""The worst first. An error keeps the policy from running as it was meant to; a warning is worth a look."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found."""

    severity: Severity
    field: str
    """Of the contract, or `model`, `golden vectors`, `robot`."""
    message: str
    """What is, and what was expected."""
    joint: str = ""
    value: float | None = None
    limit: float | None = None

    def __str__(self) -> str:
        return f"{self.field}{f' of {self.joint}' if self.joint else ''}: {self.message}"


def sorted_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The worst first, otherwise in the order in which they were found."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))
