"""How punctual a minute of `play --hardware` is on 14 emulated motors."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from humanoid_sim.bench.timing import Row

__all__ = ["hardware_loop"]

_SECONDS = 60.0
_SCRIPT = "hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold 100"


def hardware_loop(repetitions: int) -> list[Row]:  # noqa: ARG001 - the signature of a benchmark
    """Missed deadlines at 50 Hz on one bus, and what a tick takes. Measured once: a minute is repetition enough."""
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
    """The summary of a run in a process and a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        options = ("--hardware", "virtual:bench", "--allow-script", "--script", _SCRIPT, "--duration", f"{_SECONDS:g}")
        outputs = ("--viewer", "none", "--record", "r.mcap", "--summary", "s.json")
        subprocess.run(
            [sys.executable, "-m", "humanoid_sim.play", *options, *outputs],
            check=True,
            cwd=folder,
            stdout=subprocess.DEVNULL,
        )
        summary: dict[str, Any] = json.loads(Path(folder, "s.json").read_text(encoding="utf-8"))
    return summary
