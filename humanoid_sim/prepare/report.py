"""What was found out about a motion, as JSON and as a table."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.prepare.conventions import Conventions
from humanoid_sim.prepare.limits import LimitExcess
from humanoid_sim.prepare.verify import BodyCheck, RateCheck, Tolerance

__all__ = ["MotionReport", "as_json", "print_report"]


@dataclass(frozen=True, slots=True)
class MotionReport:
    """Everything that `prepare` says about a motion."""

    source: str
    kind: str
    sha256: str
    """Of the source file; empty for a dataset."""
    robot: str
    policy: str
    source_fps: float
    source_frames: int
    policy_dt: float
    """s"""
    frames: int
    """In the motion file."""
    resampled: bool
    layout: str
    bodies_from: str
    """Where the poses in the motion file come from."""
    conventions: Conventions
    method: str
    """How joints and bodies were held against each other; empty if they could not be."""
    tolerance: Tolerance
    bodies: tuple[BodyCheck, ...] = ()
    rate: RateCheck | None = None
    beyond_limits: LimitExcess | None = None
    notes: tuple[str, ...] = field(default=())


def as_json(report: MotionReport) -> dict[str, Any]:
    """As JSON values: lengths in m, angles in rad."""
    document = asdict(report)
    document["verified"] = bool(report.method)
    return document


def print_report(console: Console, report: MotionReport) -> None:
    """The table for a person: lengths in mm, angles in degrees."""
    read = report.conventions
    seconds = (report.frames - 1) * report.policy_dt
    table = Table(title=f"motion {escape(report.source)}", show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    rows = {
        "robot": f"{report.robot}, policy {report.policy}",
        "source": f"{report.kind}, {report.source_frames} frames at {report.source_fps:g} per second",
        "motion": f"{report.frames} frames at {1.0 / report.policy_dt:g} per second, {seconds:.2f} s, "
        f"layout {report.layout}, poses from {report.bodies_from}" + (", resampled" if report.resampled else ""),
        "joints": _order(read.joint_names, read.joints_said_by),
        "bodies": _order(read.body_names, read.bodies_said_by),
        "quaternions": f"{read.quaternions} ({read.quaternions_said_by})",
        "frame rate": "joint velocities say nothing about it"
        if report.rate is None
        else f"joint velocities fit {report.rate.fps:.1f} per second, correlation {report.rate.correlation:.3f}",
    }
    for name, text in rows.items():
        table.add_row(name, escape(text))
    console.print(table)
    if report.bodies:
        console.print(_bodies(report))
    for note in report.notes:
        console.print(f"[yellow]note:[/] {escape(note)}")


def _order(names: tuple[str, ...], said_by: str) -> str:
    return f"{len(names)} ({said_by})" if names else "none"


def _bodies(report: MotionReport) -> Table:
    tolerance = report.tolerance
    title = (
        f"bodies against {report.method}, tolerance {1e3 * tolerance.position:g} mm, {math.degrees(tolerance.angle):g}°"
    )
    table = Table(title=title, title_justify="left")
    table.add_column("body", no_wrap=True)
    for heading in ("mm rms", "max", "° rms", "max", "frame"):
        table.add_column(heading, justify="right")
    for body in report.bodies:
        table.add_row(
            escape(body.name),
            f"{1e3 * body.position_rms:.2f}",
            f"{1e3 * body.position_max:.2f}",
            f"{math.degrees(body.angle_rms):.3f}",
            f"{math.degrees(body.angle_max):.3f}",
            str(body.worst_frame),
            style="red" if body.excess(tolerance) > 1.0 else None,
        )
    return table
