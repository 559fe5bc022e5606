"""The final table of a run, for people and as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console

from humanoid_sim.evaluation.run_figures import REMARKS
from humanoid_sim.evaluation.run_report import describe_effort, describe_spread, print_figures, print_table
from humanoid_sim.files import json_text, whole_file
from humanoid_sim.play.assembly import Run
from humanoid_sim.session.session import SessionResult


def summarise(run: Run, result: SessionResult) -> dict[str, Any]:
    """Everything that the final table shows, in SI units and radians."""
    plan, figures = run.plan, run.monitor.figures.summary()
    return {
        "robot": plan.description.name,
        **plan.policies.settings,
        "reason": result.reason,
        "duration": result.duration,
        **figures,
        "loop": {
            "ticks": result.ticks,
            "control_period": plan.control_period,
            "realtime": plan.realtime,
            "real_time_factor": result.duration / result.wall_time,
            "overruns": result.overruns,
            "skipped_deadlines": result.skipped,
        },
        "hardware": plan.setup.figures(),
        "recording": str(plan.outputs["record"]) if "record" in plan.outputs else None,
    }


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the summary as JSON, whole or not at all; what is not a number is null."""
    with whole_file(path) as file:
        file.write(f"{json_text(summary)}\n".encode())


def print_report(console: Console, summary: dict[str, Any]) -> None:
    """Print the tables."""
    print_figures(console, summary, REMARKS[1:])  # events were printed as they happened
    loop = summary["loop"]
    pace = "in real time" if loop["realtime"] else f"{loop['real_time_factor']:.1f} times real time"
    missed = "missed deadlines" if loop["realtime"] else "ticks took longer than the control period"
    rows = [
        ("ticks", f"{loop['ticks']} at {1.0 / loop['control_period']:g} Hz, {pace}"),
        ("deadlines", f"{loop['overruns']} {missed}, {loop['skipped_deadlines']} skipped"),
        ("tick time", describe_spread(summary["tick_time"])),
        ("policy steps", str(summary["inferences"])),
        ("largest joint effort", describe_effort(summary["effort"])),
    ]
    print_table(console, "Loop", rows)
    if summary["hardware"]:
        print_table(console, "Buses and motors", [(line,) for line in summary["hardware"]["lines"]])
