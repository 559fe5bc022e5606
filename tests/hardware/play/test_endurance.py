"""Minutes of `play --hardware` on 14 emulated motors, with the figures that are claimed for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from result import Result

from humanoid_sim import replay
from humanoid_sim.cli import run_program

pytestmark = pytest.mark.slow

SCRIPT = ("--allow-script", "--script", "hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold 100")


def report(figures: dict[str, Any], what: str) -> None:
    """Print the figures, for whoever runs the tests with -s, or reads a failure."""
    loop, hardware = figures["loop"], figures["hardware"]
    print(
        f"\n{what}: {loop['ticks']} ticks at {1.0 / loop['control_period']:g} Hz, {loop['overruns']} overruns; "
        f"tick 99 % {1e3 * loop['tick_time_p99']:.2f} ms, max {1e3 * loop['tick_time_max']:.2f} ms; "
        f"late 99 % {1e3 * loop['jitter']['p99']:.2f} ms, max {1e3 * loop['jitter']['max']:.2f} ms; "
        f"{hardware['commanded']} commands, {hardware['acknowledged']} acknowledged; {'; '.join(hardware['lines'])}"
    )


def test_a_minute_at_50_hz_on_one_bus(run: Callable[..., Result]) -> None:
    result = run("--hardware", "virtual:minute", *SCRIPT, "--duration", "60")
    report(result.summary, "one bus")
    assert result.status == 0
    loop, hardware = result.summary["loop"], result.summary["hardware"]
    assert loop["ticks"] >= 3000
    is_first = any(line.startswith("SCHED_FIFO, ") for line in loop["measures"])
    assert loop["overruns"] <= (0 if is_first else 0.005 * loop["ticks"])  # else other programs may come first
    assert hardware["commanded"] == hardware["acknowledged"] >= 14 * 3000
    assert (hardware["invalid_frames"], hardware["refused"], hardware["saturations"]) == (0, 0, {})
    assert result.summary["safety"] == []
    assert run_program(replay.main, ["r.mcap"]) == 0


def test_two_buses_at_200_hz(run: Callable[..., Result]) -> None:
    """What the loop cannot keep is reported, deadline for deadline; nothing is caught up."""
    hardware_options = ("--hardware", "virtual:left,virtual:right", "--control-frequency", "200")
    result = run(*hardware_options, *SCRIPT, "--duration", "20")
    report(result.summary, "two buses")
    assert result.status == 0
    loop, hardware = result.summary["loop"], result.summary["hardware"]
    assert sum(tick.overrun for tick in result.ticks) <= loop["overruns"] <= loop["skipped_deadlines"]
    assert f"{loop['overruns']} missed deadlines, {loop['skipped_deadlines']} skipped" in result.out
    assert loop["ticks"] + loop["skipped_deadlines"] >= 20 * 200
    assert loop["tick_time_p99"] < 0.005
    assert len(hardware["channels"]) == 2
    assert hardware["acknowledged"] >= 0.999 * hardware["commanded"]
