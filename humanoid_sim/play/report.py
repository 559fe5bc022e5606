"""The final table of a run, for people and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.evaluation.failure import DEFINITIONS
from humanoid_sim.evaluation.piano_score import score
from humanoid_sim.evaluation.run_figures import describe_effort
from humanoid_sim.files import finite, whole_file
from humanoid_sim.play.assembly import Run
from humanoid_sim.play.console import MODE_STYLES
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.session import SessionResult

_SHOWN = 10
"""Faults, and safety statuses, that are printed; the summary has them all."""


def summarise(run: Run, result: SessionResult) -> dict[str, Any]:
    """Everything that the final table shows, in SI units and radians."""
    plan, monitor, keys = run.plan, run.monitor, run.keys
    return {
        "robot": plan.description.name,
        "policy": None if plan.policy.loaded is None else plan.policy.source,
        "motion": None if plan.policy.motion_file is None else str(plan.policy.motion_file),
        "reason": result.reason,
        "duration": result.duration,
        "modes": [
            {"mode": span.mode.name, **{name: getattr(span, name) for name in ("controller", "start", "end", "reason")}}
            for span in monitor.spans
        ],
        **{
            name: [{"time": time, "message": message} for time, message in getattr(monitor, name)]
            for name in ("faults", "refusals", "safety")
        },
        "loop": loop_figures(result, monitor, plan.control_period, realtime=plan.realtime),
        "effort": monitor.joints.effort(),
        "tracking": None if run.tracking is None else run.tracking.summary(),
        "base": None if monitor.base is None else monitor.base.summary(),
        "piano": None if keys is None or not len(keys.pressed) else asdict(score(keys.pressed, keys.wanted, keys.step)),
        "key_force": plan.setup.key_force(),
        "definitions": dict(DEFINITIONS),
        "hardware": plan.setup.figures(),
        "recording": None if plan.outputs.record is None else str(plan.outputs.record),
    }


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the summary as JSON, whole or not at all; what is not a number is null."""
    with whole_file(path) as file:
        file.write((json.dumps(finite(summary), indent=1, allow_nan=False) + "\n").encode())


def print_report(console: Console, summary: dict[str, Any]) -> None:
    """Print the tables."""
    styles = {mode.name: style for mode, style in MODE_STYLES.items()}
    modes = [
        (f"[{styles[one['mode']]}]{one['mode']}[/]", _s(one["start"]), _s(one["end"]), escape(one["reason"]))
        for one in summary["modes"]
    ]
    console.print(_table("Modes", modes, "mode", "from", "to", "reason"))
    if summary["tracking"]:
        title = f"Tracking, {summary['tracking']['samples']} policy steps while the motion ran"
        console.print(_table(title, _tracking(summary["tracking"]["errors"]), "error", "mean", "RMS", "max"))
    if summary["base"]:
        console.print(_table("Base, from its release on", _base(summary["base"])))
    if summary["piano"]:
        console.print(_table("Song", _piano(summary["piano"]), "keys", "precision", "recall", "F1"))
    if summary["key_force"]:
        force = summary["key_force"]
        where = f" ({force['key']} at {_s(force['time'])})" if force["key"] else ""
        limit = f"the limit is {force['limit']:g} N; {force['sunk']:.2f} N where the arms were limp"
        console.print(f"hardest touch of a key: {force['force']:.2f} N{where}, {limit}", markup=False)
    console.print(_table("Loop", loop_rows(summary["loop"], summary["effort"])))
    if summary["hardware"]:
        console.print(_table("Buses and motors", [(escape(line),) for line in summary["hardware"]["lines"]]))
    for kind in ("faults", "safety"):
        for event in summary[kind][:_SHOWN]:
            console.print(f"[red]{kind} at {_s(event['time'])}[/red]  {escape(event['message'])}", highlight=False)
    base = summary["base"]
    if base and base["fall"] is not None:
        console.print(f"[bold red]the robot fell[/] after {base['fall']:.2f} s: {escape(base['fell'])}")


def _s(seconds: float) -> str:
    return f"{seconds:.3f} s"


def _table(title: str, rows: Sequence[Sequence[str]], *headings: str) -> Table:
    table = Table(*headings, title=title, title_justify="left", show_header=bool(headings))
    for row in rows:
        table.add_row(*row)
    return table


def _tracking(errors: dict[str, Any]) -> list[tuple[str, ...]]:
    rows = []
    for name, error in errors.items():
        factor, unit = (1e3, "mm") if error["unit"] == "m" else (np.degrees(1.0), "°")
        rows.append((name, *(f"{factor * error[figure]:.1f} {unit}" for figure in ("mean", "rms", "max"))))
    return rows


def _base(base: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("height of its origin", "{:.3f} / {:.3f} / {:.3f} m, least, mean, greatest".format(*base["height"])),
        ("lowest centre of mass", f"{100.0 * base['lowest']:.0f} % of its height when standing"),
        (
            "fall",
            f"none in {base['duration']:.2f} s" if base["fall"] is None else f"[red]after {base['fall']:.2f} s[/]",
        ),
    ]
    if base["velocity"] is not None:
        forward, left = base["velocity"]
        rows.append(("mean velocity after 2 s", f"{forward:.3f} m/s forward, {left:.3f} m/s to the left"))
        rows.append(("mean yaw rate after 2 s", f"{base['yaw_rate']:.3f} rad/s"))
    if base["tilt_max"] is not None:
        rows.append(("largest tilt after 2 s", f"{np.degrees(base['tilt_max']):.1f}°"))
    return rows


def _piano(piano: dict[str, Any]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, part in (("per time step", "steps"), ("per note", "notes")):
        rows.append((name, *(f"{piano[part][ratio]:.3f}" for ratio in ("precision", "recall", "f1"))))
    struck = f"{piano['hit_count']} of {piano['note_count']} notes struck in time, {piano['false_count']} wrong strokes"
    return [*rows, (struck,)]


def loop_figures(
    result: SessionResult, monitor: RunMonitor, control_period: float, *, realtime: bool
) -> dict[str, Any]:
    """Return times in s. `budget` is the share of the control period that 99 % of the ticks stay within."""
    times, late = monitor.tick_time, result.jitter
    return {
        "ticks": result.ticks,
        "control_period": control_period,
        "realtime": realtime,
        "real_time_factor": result.duration / result.wall_time,
        "overruns": result.overruns,
        "skipped_deadlines": result.skipped,
        "tick_time_mean": times.mean,
        "tick_time_p50": times.percentile(50.0),
        "tick_time_p99": times.percentile(99.0),
        "tick_time_max": times.max,
        "budget": times.percentile(99.0) / control_period,
        "jitter": {"p50": late.percentile(50.0), "p99": late.percentile(99.0), "max": late.max} if late.count else None,
        "measures": list(result.measures),
        "inferences": monitor.inferences,
    }


def loop_rows(loop: dict[str, Any], effort: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a run's loop."""
    pace = "in real time" if loop["realtime"] else f"{loop['real_time_factor']:.1f} times real time"
    deadlines = f"{loop['overruns']} missed deadlines, {loop['skipped_deadlines']} skipped"
    if not loop["realtime"]:
        deadlines = f"none to miss; {loop['overruns']} ticks took longer than the control period"
    physics = "" if loop["measures"] else ", physics aside"
    share = f"99 % take up to {100.0 * loop['budget']:.1f} % of the period"
    rows = [
        ("ticks", f"{loop['ticks']} at {1.0 / loop['control_period']:g} Hz, {pace}"),
        ("deadlines", deadlines),
        (f"tick time{physics}", f"{_three(loop, 'tick_time_')};\n{share}"),
        ("policy steps", str(loop["inferences"])),
        ("largest joint effort", escape(describe_effort(effort))),
    ]
    if loop["jitter"]:
        rows.append(("ticks began late by", _three(loop["jitter"], "")))
    if loop["measures"]:
        rows.append(("real-time settings", "\n".join(loop["measures"])))
    return rows


def _three(figures: dict[str, Any], prefix: str) -> str:
    p50, p99, largest = (1e6 * figures[f"{prefix}{name}"] for name in ("p50", "p99", "max"))
    return f"median {p50:.0f} µs, 99 % {p99:.0f} µs, max {largest:.0f} µs"
