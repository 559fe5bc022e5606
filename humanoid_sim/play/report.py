"""The final table of a run, for people and as JSON."""

from __future__ import annotations

import json
import shlex
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
from humanoid_sim.play.options import NO_POLICY, PlayConfig
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
        "doctor": _doctor(plan.config),
        "definitions": dict(DEFINITIONS),
        "hardware": plan.setup.figures(),
        "recording": None if plan.outputs.record is None else str(plan.outputs.record),
    }


def _doctor(config: PlayConfig) -> str:
    """Give the command that finds out what is wired wrongly in this policy; empty where there is nothing to examine."""
    if not config.policy or config.policy[0] in ("placeholder", NO_POLICY):
        return ""
    command = ["python", "-m", "humanoid_sim.policy", "doctor", config.policy[0], "--robot", config.robot]
    for option in ("contract", "motion"):
        value = getattr(config, option)
        if value is not None:
            command += [f"--{option}", str(value)]
    return shlex.join(command)


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the summary as JSON, whole or not at all; what is not a number is null."""
    with whole_file(path) as file:
        file.write((json.dumps(finite(summary), indent=1, allow_nan=False) + "\n").encode())


def print_report(console: Console, summary: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(_modes(summary))
    for name, table in (("tracking", _tracking), ("base", _base), ("piano", _piano)):
        if summary[name]:
            console.print(table(summary[name]))
    if summary["key_force"]:
        force = summary["key_force"]
        where = f" ({force['key']} at {force['time']:.3f} s)" if force["key"] else ""
        limit = f"the limit is {force['limit']:g} N; {force['sunk']:.2f} N where the arms were limp"
        console.print(f"hardest touch of a key: {force['force']:.2f} N{where}, {limit}", markup=False)
    console.print(loop_table(summary["loop"], summary["effort"]))
    if summary["hardware"]:
        console.print(_hardware(summary["hardware"]))
    for kind in ("fault", "safety"):
        for event in summary["faults" if kind == "fault" else kind][:_SHOWN]:
            console.print(f"[red]{kind} at {event['time']:.3f} s[/red]  {escape(event['message'])}", highlight=False)
    base = summary["base"]
    if base and base["fall"] is not None:
        console.print(f"[bold red]the robot fell[/] after {base['fall']:.2f} s: {escape(base['fell'])}")
        if summary["doctor"]:
            console.print(f"which wiring would keep it up: {summary['doctor']}", markup=False, soft_wrap=True)


def _modes(summary: dict[str, Any]) -> Table:
    table = Table("mode", "from", "to", "reason", title="Modes", title_justify="left")
    styles = {mode.name: style for mode, style in MODE_STYLES.items()}
    for span in summary["modes"]:
        name = f"[{styles[span['mode']]}]{span['mode']}[/]"
        table.add_row(name, f"{span['start']:.3f} s", f"{span['end']:.3f} s", escape(span["reason"]))
    return table


def _tracking(tracking: dict[str, Any]) -> Table:
    title = f"Tracking, {tracking['samples']} policy steps while the motion ran"
    table = Table("error", "mean", "RMS", "max", title=title, title_justify="left")
    for name, error in tracking["errors"].items():
        factor, unit = (1e3, "mm") if error["unit"] == "m" else (np.degrees(1.0), "°")
        table.add_row(name, *(f"{factor * error[figure]:.1f} {unit}" for figure in ("mean", "rms", "max")))
    return table


def _hardware(figures: dict[str, Any]) -> Table:
    table = Table("figure", title="Buses and motors", title_justify="left")
    table.show_header = False
    for line in figures["lines"]:
        table.add_row(escape(line))
    return table


def _base(base: dict[str, Any]) -> Table:
    table = Table(title="Base, from its release on", show_header=False, title_justify="left")
    if base["velocity"] is not None:
        forward, left = base["velocity"]
        table.add_row("mean velocity after 2 s", f"{forward:.3f} m/s forward, {left:.3f} m/s to the left")
        table.add_row("mean yaw rate after 2 s", f"{base['yaw_rate']:.3f} rad/s")
    table.add_row("height of its origin", "{:.3f} / {:.3f} / {:.3f} m, least, mean, greatest".format(*base["height"]))
    table.add_row("lowest centre of mass", f"{100.0 * base['lowest']:.0f} % of its height when standing")
    if base["tilt_max"] is not None:
        table.add_row("largest tilt after 2 s", f"{np.degrees(base['tilt_max']):.1f}°")
    stood, fell = f"none in {base['duration']:.2f} s", base["fall"]
    table.add_row("fall", stood if fell is None else f"[red]after {fell:.2f} s[/red]")
    return table


def _piano(piano: dict[str, Any]) -> Table:
    ratios = ("precision", "recall", "F1")
    table = Table("keys", *ratios, title="Song", title_justify="left")
    for name, part in (("per time step", "steps"), ("per note", "notes")):
        table.add_row(name, *(f"{piano[part][ratio.lower()]:.3f}" for ratio in ratios))
    table.caption = (
        f"{piano['hit_count']} of {piano['note_count']} notes struck in time, {piano['false_count']} wrong strokes"
    )
    return table


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


def loop_table(loop: dict[str, Any], effort: dict[str, Any]) -> Table:
    """Return the table of a run's loop."""
    table = Table(title="Loop", show_header=False, title_justify="left")
    pace = "in real time" if loop["realtime"] else f"{loop['real_time_factor']:.1f} times real time"
    table.add_row("ticks", f"{loop['ticks']} at {1.0 / loop['control_period']:g} Hz, {pace}")
    overruns = f"{loop['overruns']} missed deadlines, {loop['skipped_deadlines']} skipped"
    if not loop["realtime"]:
        overruns = f"none to miss; {loop['overruns']} ticks took longer than the control period"
        if loop["overruns"]:
            overruns += "\n(this machine was busy; simulated time lost nothing)"
    table.add_row("deadlines", overruns)
    physics = "" if loop["measures"] else ", physics aside"
    table.add_row(
        f"tick time{physics}",
        f"{_three(loop, 'tick_time_')};\n99 % take up to {100.0 * loop['budget']:.1f} % of the period",
    )
    if loop["jitter"]:
        table.add_row("ticks began late by", _three(loop["jitter"], ""))
    if loop["measures"]:
        table.add_row("real-time settings", "\n".join(loop["measures"]))
    table.add_row("policy steps", str(loop["inferences"]))
    table.add_row("largest joint effort", escape(describe_effort(effort)))
    return table


def _three(figures: dict[str, Any], prefix: str) -> str:
    p50, p99, largest = (1e6 * figures[f"{prefix}{name}"] for name in ("p50", "p99", "max"))
    return f"median {p50:.0f} µs, 99 % {p99:.0f} µs, max {largest:.0f} µs"
