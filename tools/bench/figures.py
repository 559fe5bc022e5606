"""All figures: measured, printed and compared with their targets.

Those of whole processes, a start and a minute of the hardware loop, are measured here.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
from rich.console import Console
from rich.progress import track
from rich.table import Table

from humanoid_sim import __version__
from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from tools.bench import BenchOptions
from tools.bench.batches import height_scans, piano_scene, regress_speed, vector_step
from tools.bench.one_robot import (
    control_tick,
    environment_step,
    feed_cost,
    real_time_factor,
    recorder_cost,
    supervisor_step,
)
from tools.bench.plants import implicit_plant
from tools.bench.timing import Row, paired_ratio

__all__ = ["print_figures"]

_SECONDS = 60.0
_SCRIPT = "hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold 100"


def _help_start(repetitions: int) -> list[Row]:
    """`play --help` over an interpreter that does nothing."""

    def run(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)

    def describe(ours: float, bare: float) -> str:
        return f"{1e3 * ours:.0f} ms, {1e3 * bare:.0f} ms for python -c pass"

    return [
        paired_ratio(
            "play --help",
            lambda: run("-m", "humanoid_sim.play", "--help"),
            lambda: run("-c", "pass"),
            repetitions,
            15.0,
            describe,
        )
    ]


def _hardware_loop(repetitions: int) -> list[Row]:  # noqa: ARG001 - the signature of a benchmark
    """Missed deadlines at 50 Hz on one bus, and what a tick takes. Measured once: a minute is long enough."""
    summary = _minute()
    loop, hardware = summary["loop"], summary["hardware"]
    overruns, p99 = float(loop["overruns"]), 1e3 * loop["tick_time_p99"]
    fifo = next((line for line in loop["measures"] if "SCHED_FIFO" in line), "no SCHED_FIFO")
    missed = f"of {loop['ticks']} ticks; {hardware['acknowledged']} of {hardware['commanded']} commands acknowledged"
    return [
        Row("hardware loop, overruns in 60 s", overruns, "", overruns, overruns, 0.0, f"{missed}; {fifo}"),
        Row(
            "hardware loop, tick, 99 %", p99, "ms", p99, p99, None, f"max {1e3 * loop['tick_time_max']:.2f} ms of 20 ms"
        ),
    ]


def _minute() -> dict[str, Any]:
    """Return the summary of a run in a process and a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        options = ("--hardware", "virtual:bench", "--policy", "lite_tracking", "--duration", f"{_SECONDS:g}")
        script = ("--allow-script", "--script", _SCRIPT)
        outputs = ("--viewer", "none", "--record", "r.mcap", "--summary", "s.json")
        subprocess.run(
            [sys.executable, "-m", "humanoid_sim.play", *options, *script, *outputs],
            check=True,
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        summary: dict[str, Any] = json.loads(Path(folder, "s.json").read_text(encoding="utf-8"))
    return summary


_BENCHMARKS: dict[str, Callable[[int], list[Row]]] = {
    "control tick": control_tick,
    "play --help": _help_start,
    "supervisor step": supervisor_step,
    "recording": recorder_cost,
    "feed": feed_cost,
    "real time": real_time_factor,
    "LiteTracking-v0.step": environment_step,
    "vector": vector_step,
    "piano": piano_scene,
    "height scan": height_scans,
    "implicit plant": implicit_plant,
    "regress": regress_speed,
    "hardware loop": _hardware_loop,
}


def print_figures(options: BenchOptions) -> int:
    """Measure and print; the exit status is 1 if a target was missed.

    Raises `InputError` if the options select nothing.
    """
    if options.repetitions < 1:
        raise InputError(f"--repetitions: is {options.repetitions}, expected a whole number >= 1")
    chosen = {name: run for name, run in _BENCHMARKS.items() if options.only is None or options.only in name}
    if not chosen:
        raise InputError(f"--only: is '{options.only}', expected part of one of {', '.join(_BENCHMARKS)}")
    progress = Console(stderr=True)
    names = track(list(chosen), description="measuring", console=progress, transient=True, disable=options.json)
    rows = [row for name in names for row in chosen[name](options.repetitions)]
    if options.json:
        document = {"machine": _machine(), "rows": [{**asdict(row), "met": row.is_met} for row in rows]}
        print(json.dumps(document, indent=1))
    else:
        _print(rows, options.repetitions)
    return ExitStatus.of(all(row.is_met for row in rows))


def _machine() -> dict[str, object]:
    return {
        "cpus": os.cpu_count(),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "mujoco": mujoco.__version__,
        "onnxruntime": version("onnxruntime"),
        "humanoid_sim": __version__,
    }


def _print(rows: list[Row], repetitions: int) -> None:
    console = Console()
    table = Table(title=f"medians of {repetitions} repetitions", title_justify="left")
    table.add_column("figure")
    for heading in ("median", "range", "target"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for row in rows:
        unit = "" if row.unit == "ratio" else f" {row.unit}"
        colour, sign = "green" if row.is_met else "red", "≥" if row.at_least else "≤"
        target = "" if row.target is None else f"[{colour}]{sign} {row.target:g}[/]"
        spread = f"{row.low:.2f}–{row.high:.2f}"
        table.add_row(row.name, f"{row.value:.2f}{unit}", spread, target, row.detail)
    console.print(table)
    console.print("  ".join(f"{key} {value}" for key, value in _machine().items()), style="dim", highlight=False)
