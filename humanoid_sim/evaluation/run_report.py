"""Tables of a run's figures, for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.evaluation.run_figures import REMARKS
from humanoid_sim.messages import Mode

MODE_STYLES = {
    Mode.ZERO_TORQUE: "bright_black",
    Mode.DAMPING: "yellow",
    Mode.STANDBY: "cyan",
    Mode.LOCOMOTION: "green",
    Mode.REMOTE: "magenta",
}
_UNITS = {"m": (1e3, "mm"), "rad": (180.0 / math.pi, "°"), "rad/s": (180.0 / math.pi, "°/s"), "share": (100.0, "%")}
"""By unit what to multiply a value by for a person, and the unit that it then has."""
_SHOWN = 40  # of these that are printed; JSON has them all


def quantity(value: float | None, unit: str, *, signed: bool = False) -> str:
    """Return a value with the unit that a person reads it in, such as `12.1 mm`; empty where there is none."""
    if value is None:
        return ""
    factor, shown = _UNITS.get(unit, (1.0, unit))
    return f"{round(factor * value, 9):{'+' if signed else ''}.3g} {shown}"


def print_table(console: Console, title: str, rows: Iterable[Sequence[str]], *headings: str) -> None:
    """Print a table of texts without markup; nothing if it has no rows."""
    table = Table(*headings, title=escape(title), title_justify="left", show_header=bool(headings))
    for row in rows:
        table.add_row(*map(escape, row))
    if table.row_count:
        console.print(table)


def print_figures(console: Console, summary: dict[str, Any], kinds: Sequence[str] = REMARKS) -> None:
    """Print what `RunFigures.summary` returns, with these kinds of remarks."""
    modes = [
        (one["mode"], _s(one["start"]), _s(one["end"]), one["controller"], one["reason"]) for one in summary["modes"]
    ]
    print_table(console, "Modes", modes, "mode", "from", "to", "controller", "reason")
    tracking, base, piano = (summary[name] for name in ("tracking", "base", "piano"))
    if tracking:
        rows = [
            (name, *(quantity(error[figure], error["unit"]) for figure in ("mean", "rms", "max")))
            for name, error in tracking["errors"].items()
        ]
        title = f"Tracking, {tracking['samples']} policy steps while the motion ran"
        print_table(console, title, rows, "error", "mean", "RMS", "max")
    if base and base["velocity"]:
        forward, left, turning = base["velocity"]
        text = f"{forward:.3f} m/s forward, {left:.3f} m/s to the left, {turning:.3f} rad/s"
        console.print(f"mean velocity from 2 s after the release of the base: {text}", markup=False)
    if piano:
        print_table(console, "Song", [[f"{ratio:.3f}" for ratio in piano.values()]], "precision", "recall", "F1")
    remarks = [(one["time"], kind, one["message"]) for kind in kinds for one in summary[kind]]
    shown = [(_s(time), kind, message) for time, kind, message in sorted(remarks)[:_SHOWN]]
    print_table(console, f"{', '.join(kinds).capitalize()}: {len(shown)} of {len(remarks)}", shown, "at", "", "")
    if base and base["fall"] is not None:
        console.print(f"[bold red]the robot fell[/] after {base['fall']:.2f} s: {escape(base['fell'])}")


def describe_spread(seconds: dict[str, float] | None) -> str:
    """Return durations as `median 120 µs, 99 % 300 µs, max 900 µs`."""
    if seconds is None:
        return "-"
    median, p99, largest = (1e6 * seconds[name] for name in ("median", "p99", "max"))
    return f"median {median:.0f} µs, 99 % {p99:.0f} µs, max {largest:.0f} µs"


def describe_effort(efforts: Sequence[dict[str, Any]]) -> str:
    """Return the effort closest to its limit: `37.1 of 88 N·m at left_knee_joint`."""
    joint, peak, limit = (efforts[0][name] for name in ("joint", "peak", "limit"))
    return f"{peak:.1f}{f' of {limit:g}' if math.isfinite(limit) else ''} N·m at {joint}"


def _s(seconds: float) -> str:
    return f"{seconds:.3f} s"
