"""Long runs of `play --hardware` on 14 emulated motors, with the figures that are claimed for it."""

import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program

pytestmark = pytest.mark.soak

WALK = "hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold 100"
SCRIPT = ("--policy", "lite_tracking", "--allow-script", "--script", WALK)


def report(figures, what):
    """Print the figures, for whoever runs the tests with -s, or reads a failure."""
    loop, hardware = figures["loop"], figures["hardware"]
    print(
        f"\n{what}: {loop['ticks']} ticks at {1.0 / loop['control_period']:g} Hz, {loop['overruns']} overruns; "
        f"tick 99 % {1e3 * loop['tick_time_p99']:.2f} ms, max {1e3 * loop['tick_time_max']:.2f} ms; "
        f"late 99 % {1e3 * loop['jitter']['p99']:.2f} ms, max {1e3 * loop['jitter']['max']:.2f} ms; "
        f"{'; '.join(hardware['lines'])}"
    )


@pytest.fixture
def seconds(request):
    """How long a run takes, s; a minute with --complete."""
    return 60 if request.config.getoption("--complete") else 20


@pytest.mark.parametrize("robot", ["lite", "lite_sito"])
def test_no_deadline_is_missed_at_50_hz_on_one_bus(robot, run, seconds):
    """Of one family, and of two: ten motors that answer each command, and four that answer none. On an idle machine."""
    options = ("--hardware", "virtual:minute", "--robot", robot, *SCRIPT, "--duration", str(seconds))
    result = run(*options, *(("--allow-no-timeout",) if robot == "lite_sito" else ()))
    report(result.summary, f"{robot} on one bus")
    assert result.status == 0
    loop, hardware = result.summary["loop"], result.summary["hardware"]
    assert loop["ticks"] + loop["skipped_deadlines"] >= 50 * seconds
    assert loop["overruns"] == 0
    assert hardware["answers"] >= 14 * hardware["commands"] >= 14 * loop["ticks"]
    assert ([each["stale"] for each in hardware["channels"]], hardware["saturated"]) == ([0], {})
    assert result.summary["safety"] == []
    assert run_program(replay.main, ["r.mcap"]) == 0
