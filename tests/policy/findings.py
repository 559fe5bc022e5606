"""Looking for one finding among others."""

from typing import Any

from humanoid_sim.policy.findings import Finding


def found(findings: Any, line: str) -> Finding:
    """The one finding of `severity field: words of its message`."""
    start, _, words = line.partition(": ")
    hits = [one for one in findings if f"{one.severity} {one.field}" == start and words in one.message]
    assert len(hits) == 1, "\n".join(f"{one.severity} {one}" for one in findings)
    return hits[0]
