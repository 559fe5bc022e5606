"""Take the figures that were asked for and print them."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version

import mujoco
from rich.console import Console
from rich.progress import track
from rich.table import Table

from humanoid_sim import __version__
from humanoid_sim.bench.config import BenchConfig
from humanoid_sim.bench.control_tick import control_tick, real_time_factor, recorder_cost, supervisor_step
from humanoid_sim.bench.environment import environment_step
from humanoid_sim.bench.hardware_loop import hardware_loop
from humanoid_sim.bench.regress_speed import regress_speed
from humanoid_sim.bench.startup import help_start
from humanoid_sim.bench.timing import Row
from humanoid_sim.bench.vector import vector_step
from humanoid_sim.errors import InputError

__all__ = ["bench"]

_BENCHMARKS: dict[str, Callable[[int], list[Row]]] = {
    "control tick": control_tick,
    "play --help": help_start,
    "supervisor step": supervisor_step,
    "recording": recorder_cost,
    "real time": real_time_factor,
    "LiteTracking-v0.step": environment_step,
    "vector": vector_step,
    "regress": regress_speed,
    "hardware loop": hardware_loop,
}


def bench(config: BenchConfig) -> int:
    """Measure and print; the exit status is 1 if a target was missed.

    Raises:
        InputError: if the options select nothing.
    """
    if config.repetitions < 1:
        raise InputError(f"--repetitions: is {config.repetitions}, expected a whole number >= 1")
    chosen = {name: run for name, run in _BENCHMARKS.items() if config.only is None or config.only in name}
    if not chosen:
        raise InputError(f"--only: is '{config.only}', expected part of one of {', '.join(_BENCHMARKS)}")
    progress = Console(stderr=True)
    names = track(list(chosen), description="measuring", console=progress, transient=True, disable=config.json)
    rows = [row for name in names for row in chosen[name](config.repetitions)]
    if config.json:
        print(
            json.dumps({"machine": _machine(), "rows": [{**asdict(row), "met": row.is_met} for row in rows]}, indent=1)
        )
    else:
        _print(rows, config.repetitions)
    return 0 if all(row.is_met for row in rows) else 1


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
    for heading, justify in (("figure", "left"), ("median", "right"), ("range", "right"), ("target", "right")):
        table.add_column(heading, justify="right" if justify == "right" else "left")
    table.add_column("")
    for row in rows:
        unit = "" if row.unit == "ratio" else f" {row.unit}"
        target = (
            ""
            if row.target is None
            else f"[{'green' if row.is_met else 'red'}]{'≥' if row.at_least else '≤'} {row.target:g}[/]"
        )
        spread = f"{row.low:.2f}–{row.high:.2f}"
        table.add_row(row.name, f"{row.value:.2f}{unit}", spread, target, row.detail)
    console.print(table)
    console.print("  ".join(f"{key} {value}" for key, value in _machine().items()), style="dim", highlight=False)
