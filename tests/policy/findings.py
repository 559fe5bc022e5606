"""Looking for one finding among others."""

from typing import Any

from humanoid_sim.policy.findings import Finding


def found(findings: Any, severity: str, field: str, words: str = "") -> Finding:
    """The one finding of that kind whose message has these words."""
    findings = tuple(findings)
    hits = [f for f in findings if (f.severity, f.field) == (severity, field) and words in f.message]
    assert len(hits) == 1, "\n".join(f"{f.severity} {f}" for f in findings)
    return hits[0]
