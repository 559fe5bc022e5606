"""`play --hardware` on a robot with motors of two families, in every mode."""

import numpy as np
import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program

HARDWARE = ("--hardware", "virtual:play-sito", "--policy", "placeholder")
WALK = (
    "hold 0.1; damp; hold 0.1; load_a; wait; start_locomotion; hold 0.5; damp; hold 0.1; "
    "load_b; wait; start_remote; hold 0.5; damp; hold 0.1"
)


@pytest.mark.soak
def test_all_modes(run, make_robot):
    options = ("--allow-no-timeout", "--allow-script", "--remote", "gravity", "--script", WALK)
    result = run("--robot", make_robot("lite_sito"), *HARDWARE, *options)
    assert (result.status, result.err) == (0, "")
    walked = ["DAMPING", "STANDBY", "LOCOMOTION", "DAMPING", "STANDBY", "REMOTE", "DAMPING"]
    assert result.modes == ["ZERO_TORQUE", *walked]
    assert result.summary["safety"] == []
    assert result.summary["hardware"]["commands"] >= len(result.ticks)
    first = result.ticks[0]
    assert np.isfinite(first.input.state.joint_position).all()
    for tick in result.ticks:
        assert (tick.input.state.joint_age < 0.1).all()
    assert "right_wrist_pitch: mock motors of this process, with which they end; no watchdog" in result.out
    assert run_program(replay.main, ["r.mcap"]) == 0
