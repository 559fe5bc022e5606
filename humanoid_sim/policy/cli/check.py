"""`policy check`: what is wrong, or looks wrong, with a checkpoint for a robot."""

from __future__ import annotations

import json
from dataclasses import asdict

from rich.markup import escape

from humanoid_sim.policy.check.finding import SEVERITIES, Finding, Severity
from humanoid_sim.policy.check.program import check_checkpoint
from humanoid_sim.policy.cli.options import Check
from humanoid_sim.policy.cli.show import make_console
from humanoid_sim.robots.description import load_robot

__all__ = ["check"]

_STYLES: dict[Severity, str] = {"error": "bold red", "warning": "yellow", "info": "cyan"}
_PLURALS: dict[Severity, str] = {"error": "error(s)", "warning": "warning(s)", "info": "remark(s)"}


def check(options: Check) -> int:
    """Print the findings; exit status 1 if there is an error among them."""
    description = load_robot(options.robot)
    findings = check_checkpoint(
        options.checkpoint,
        description,
        options.contract,
        hardware=options.hardware,
        physics_timestep=options.physics_timestep,
    )
    counts = {severity: sum(finding.severity == severity for finding in findings) for severity in SEVERITIES}
    if options.json:
        document = {
            "checkpoint": str(options.checkpoint),
            "robot": description.name,
            "counts": counts,
            "findings": [asdict(finding) for finding in findings],
        }
        print(json.dumps(document, indent=2))
    else:
        _print(findings, counts, f"{options.checkpoint} on '{description.name}'")
    return int(counts["error"] > 0)


def _print(findings: tuple[Finding, ...], counts: dict[Severity, int], what: str) -> None:
    console = make_console()
    for finding in findings:
        style = _STYLES[finding.severity]
        console.print(f"[{style}]{finding.severity:<8}[/{style}]{escape(str(finding))}", soft_wrap=True)
    total = ", ".join(f"{counts[severity]} {_PLURALS[severity]}" for severity in SEVERITIES)
    console.print(f"{escape(what)}: {total}", soft_wrap=True)
