"""The final table of a run, for people and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.evaluation.base_motion import BaseMotion
from humanoid_sim.evaluation.tracking import AnchorErrors, TrackingSummary
from humanoid_sim.files import whole_file
from humanoid_sim.play.assembly import Run
from humanoid_sim.play.console import MODE_STYLES
from humanoid_sim.play.loop_figures import loop_figures, loop_table
from humanoid_sim.session.session import SessionResult

__all__ = ["print_report", "summarise", "write_summary"]

_SHOWN = 10
"""Faults, and safety statuses, that are printed; the summary has them all."""


def summarise(run: Run, result: SessionResult) -> dict[str, Any]:
    """Everything that the final table shows, in SI units and radians."""
    plan, monitor = run.plan, run.monitor
    summary: dict[str, Any] = {
        "robot": plan.description.name,
        "policy": plan.policy.checkpoint.source,
        "motion": None if plan.policy.motion_file is None else str(plan.policy.motion_file),
        "reason": result.reason,
        "duration": result.duration,
        "modes": [
            {
                "mode": span.mode.name,
                "controller": span.controller,
                "start": span.start,
                "end": span.end,
                "reason": span.reason,
            }
            for span in monitor.spans
        ],
        "faults": [{"time": time, "message": message} for time, message in monitor.faults],
        "refusals": [{"time": time, "message": message} for time, message in monitor.refusals],
        "safety": [{"time": time, "message": message} for time, message in monitor.safety],
        "not_kept": monitor.dropped,
        "loop": loop_figures(result, monitor, plan.control_period, realtime=plan.realtime),
        "effort": {"largest": monitor.largest_effort, "saturated_ticks": monitor.saturated},
        "tracking": None if run.tracking is None else _tracking_figures(run.tracking.summary()),
        "anchor": _figures(run.anchor),
        "base": _figures(run.monitor.base),
        "hardware": plan.parts.figures(),
        "never_injected": list(plan.injector.pending),
        "recording": None if plan.outputs.record is None else str(plan.outputs.record),
    }
    return summary


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the summary as JSON, whole or not at all."""
    with whole_file(path) as file:
        file.write((json.dumps(summary, indent=1) + "\n").encode())


def print_report(console: Console, summary: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(_modes(summary))
    if summary["tracking"]:
        console.print(_tracking(summary["tracking"]))
    if summary["anchor"]:
        console.print(_anchor(summary["anchor"]))
    if summary["base"]:
        console.print(_base(summary["base"]))
    console.print(loop_table(summary["loop"], summary["effort"]))
    if summary["hardware"]:
        console.print(_hardware(summary["hardware"]))
    for kind in ("fault", "safety"):
        for event in summary["faults" if kind == "fault" else kind][:_SHOWN]:
            console.print(f"[red]{kind} at {event['time']:.3f} s[/red]  {escape(event['message'])}", highlight=False)
    for injection in summary["never_injected"]:
        console.print(f"[yellow]--inject {injection}: never came about[/yellow], the run was over or in another mode")


def _modes(summary: dict[str, Any]) -> Table:
    table = Table(title="Modes", title_justify="left", title_style="bold")
    for heading in ("mode", "from", "to", "reason"):
        table.add_column(heading, justify="right" if heading in ("from", "to") else "left")
    styles = {mode.name: style for mode, style in MODE_STYLES.items()}
    for span in summary["modes"]:
        name = f"[{styles[span['mode']]}]{span['mode']}[/]"
        table.add_row(name, f"{span['start']:.3f} s", f"{span['end']:.3f} s", escape(span["reason"]))
    return table


def _figures(part: AnchorErrors | BaseMotion | None) -> dict[str, Any] | None:
    summary = None if part is None else part.summary()
    return None if summary is None else asdict(summary)


def _tracking_figures(tracking: TrackingSummary) -> dict[str, Any] | None:
    return asdict(tracking) if tracking.samples else None


def _tracking(tracking: dict[str, Any]) -> Table:
    title = f"Tracking, {tracking['samples']} policy steps, hands up to {tracking['peak_speed']:.2f} m/s"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("body")
    for heading in ("position RMS", "max", "orientation RMS", "max"):
        table.add_column(heading, justify="right")
    for errors in tracking["bodies"]:
        table.add_row(errors["name"], *_error_cells(errors))
    table.add_section()
    table.add_row("[bold]hands[/bold]", *_error_cells(tracking["hands"]))
    return table


def _error_cells(errors: dict[str, Any]) -> tuple[str, ...]:
    return (
        f"{1e3 * errors['position_rms']:.1f} mm",
        f"{1e3 * errors['position_max']:.1f} mm",
        f"{np.degrees(errors['orientation_rms']):.1f}°",
        f"{np.degrees(errors['orientation_max']):.1f}°",
    )


def _anchor(anchor: dict[str, Any]) -> Table:
    table = Table(title=f"Reference, {anchor['samples']} policy steps", title_justify="left", title_style="bold")
    for heading in ("error", "mean", "max"):
        table.add_column(heading, justify="left" if heading == "error" else "right")
    for name, key, unit in (
        ("joints, mean of all", "joint_error", "rad"),
        ("anchor position", "anchor_position", "m"),
        ("anchor angle", "anchor_angle", "rad"),
    ):
        table.add_row(name, *(f"{value:.3f} {unit}" for value in anchor[key]))
    return table


def _hardware(figures: dict[str, Any]) -> Table:
    table = Table(title="Buses and motors", title_justify="left", title_style="bold", show_header=False)
    table.add_column("figure")
    for line in figures["lines"]:
        table.add_row(escape(line))
    return table


def _base(base: dict[str, Any]) -> Table:
    table = Table(title="Base, from its release on", title_justify="left", title_style="bold", show_header=False)
    table.add_column("figure")
    table.add_column("value")
    forward, left = base["velocity"]
    table.add_row("mean velocity after 2 s", f"{forward:.3f} m/s forward, {left:.3f} m/s to the left")
    table.add_row("mean yaw rate after 2 s", f"{base['yaw_rate']:.3f} rad/s")
    table.add_row("height", "{:.3f} / {:.3f} / {:.3f} m, least, mean, greatest".format(*base["height"]))
    table.add_row("largest tilt", f"{np.degrees(base['tilt_max']):.1f}°")
    stood, fell = f"none in {base['duration']:.2f} s", base["fall"]
    table.add_row("fall", stood if fell is None else f"[red]after {fell:.2f} s[/red]")
    return table
