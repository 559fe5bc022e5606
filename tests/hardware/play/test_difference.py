"""What a bus does to a policy, and how much of it the delays of the simulation explain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from result import Result

from humanoid_sim import compare
from humanoid_sim.cli import run_program
from humanoid_sim.compare import compare_runs, read_policy_run

pytestmark = pytest.mark.slow

SCRIPT = ("--script", "hold 0.5; damp; hold 1; load_a; wait; hold 0.2; start_locomotion; motion; damp")


def test_delay_and_sampling_explain_most_of_the_difference(run: Callable[..., Result], folder: Path) -> None:
    """The bus of 14 motors: a command is 1.1 ms on its way on average, and so is the answer, or the latest report."""
    assert run("--hardware", "virtual:lite", "--allow-script", *SCRIPT).status == 0
    (folder / "r.mcap").rename(folder / "bus.mcap")
    bus = read_policy_run(folder / "bus.mcap")
    age = round(float(bus.joint_age.mean()) / 0.0005) * 0.0005  # as the bus shows it, in physics steps
    assert 0.0005 <= age <= 0.01
    options = ("--control-frequency", "50", *SCRIPT)
    assert run(*options, "--record", "direct.mcap", record=False).status == 0
    delays = ("--command-delay", "0.0015", "--state-delay", f"{age:.4f}")
    assert run(*options, *delays, "--record", "delayed.mcap", record=False).status == 0
    assert run_program(compare.main, ["bus.mcap", "direct.mcap", "delayed.mcap"]) == 0
    direct, delayed = compare_runs(bus, [read_policy_run(folder / f"{name}.mcap") for name in ("direct", "delayed")])
    assert direct.frames == delayed.frames > 390
    assert 0.0005 < direct.position_rms < 0.004  # rad
    assert delayed.position_rms < 0.001
    assert delayed.explained is not None
    assert delayed.explained > 0.5
    assert delayed.action_rms < 0.6 * direct.action_rms
