"""How punctual a run was: for the summary as JSON, and as a table."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.pace import DurationHistogram
from humanoid_sim.session.session import SessionResult

__all__ = ["loop_figures", "loop_table"]

_EDGES = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
"""s, upper edges of the bars of the jitter histogram; the last bar is beyond."""
_BAR = 30
"""Characters of the longest bar."""


def loop_figures(
    result: SessionResult, monitor: RunMonitor, control_period: float, *, realtime: bool
) -> dict[str, Any]:
    """Times in s. `budget` is the share of the control period that 99 % of the ticks stay within."""
    times = monitor.tick_time
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
        "jitter": _jitter(result.jitter) if result.jitter.count else None,
        "measures": list(result.measures),
        "inferences": monitor.inferences,
    }


def _jitter(late: DurationHistogram) -> dict[str, Any]:
    """How long after its due time each tick began."""
    counts = late.counts(_EDGES)
    return {
        "p50": late.percentile(50.0),
        "p99": late.percentile(99.0),
        "max": late.max,
        "histogram": [{"up_to": edge, "ticks": count} for edge, count in zip((*_EDGES, None), counts, strict=True)],
    }


def loop_table(loop: dict[str, Any], effort: dict[str, Any]) -> Table:
    """The table of a run's loop."""
    table = Table(title="Loop", title_justify="left", title_style="bold", show_header=False)
    table.add_column("figure")
    table.add_column("value")
    pace = "in real time" if loop["realtime"] else f"{loop['real_time_factor']:.1f} times real time"
    table.add_row("ticks", f"{loop['ticks']} at {1.0 / loop['control_period']:g} Hz, {pace}")
    overruns = f"{loop['overruns']} missed deadlines, {loop['skipped_deadlines']} skipped"
    if not loop["realtime"]:
        overruns = f"none to miss; {loop['overruns']} ticks took longer than the control period"
    table.add_row("deadlines", overruns)
    physics = "" if loop["measures"] else ", physics aside"
    table.add_row(
        f"tick time{physics}",
        f"{_three(loop, 'tick_time_')};\n99 % take up to {100.0 * loop['budget']:.1f} % of the period",
    )
    if loop["jitter"]:
        table.add_row("ticks began late by", _three(loop["jitter"], ""))
        table.add_row("", "\n".join(_bars(loop["jitter"]["histogram"])))
    if loop["measures"]:
        table.add_row("for punctuality", "\n".join(loop["measures"]))
    table.add_row("policy steps", str(loop["inferences"]))
    table.add_row(
        "largest joint effort", f"{effort['largest']:.2f} N·m, {effort['saturated_ticks']} ticks at an effort limit"
    )
    return table


def _three(figures: dict[str, Any], prefix: str) -> str:
    p50, p99, largest = (1e6 * figures[f"{prefix}{name}"] for name in ("p50", "p99", "max"))
    return f"median {p50:.0f} µs, 99 % {p99:.0f} µs, max {largest:.0f} µs"


def _bars(histogram: list[dict[str, Any]]) -> list[str]:
    """One line per bar, from the first to the last that is not empty."""
    filled = [i for i, bar in enumerate(histogram) if bar["ticks"]]
    longest = max(bar["ticks"] for bar in histogram)
    lines = []
    for bar in histogram[filled[0] : filled[-1] + 1]:
        name = "above" if bar["up_to"] is None else f"≤ {1e3 * bar['up_to']:g} ms"
        length = -(-_BAR * bar["ticks"] // longest)  # rounded up: one tick in a million is worth a mark
        lines.append(f"{name:<10} {'█' * length} {bar['ticks']}")
    return lines
