"""A monitor, a process of its own, that reports a fault or falls silent, in every mode on emulated motors."""

import subprocess
import sys
from contextlib import contextmanager

import pytest
from fates import on_motors, playing, skip_unless
from waiting import until

from humanoid_sim.messages import Mode

pytestmark = pytest.mark.soak

MONITOR = """
import sys, time
from humanoid_sim.client import Intake, find_session
with Intake(find_session(int(sys.argv[1])), "monitor") as intake:
    print(intake.safety("lidar", 0).text, flush=True)
    for line in sys.stdin:
        stamp = time.monotonic_ns()
        intake.post_safety("lidar", int(line), "blind")
        print(stamp, flush=True)
"""


class Monitor:
    """Reports a level, and gives the moment at which it did, ns of CLOCK_MONOTONIC."""

    def __init__(self, process):
        self.process = process

    def report(self, level):
        self.process.stdin.write(f"{level}\n")
        self.process.stdin.flush()
        return int(self.process.stdout.readline())


@contextmanager
def monitor(played):
    command = [sys.executable, "-c", MONITOR, str(played.process.pid)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "lidar is OK\n"
            yield Monitor(process)
        finally:
            process.kill()


def first_with_fault(played, after):
    """The first tick after that number which took the fault in."""
    for sample in played.feed.since(after):
        levels = {status["source"]: status["level"] for status in played.feed.decode(sample)["safety"]}
        if levels.get("lidar") == 2:
            return sample
    return until(lambda: None)  # fails


@pytest.mark.parametrize("mode", Mode)
def test_a_fault_of_another_process_damps_in_that_tick(rows, folder, mode, request):
    skip_unless(mode in (Mode.STANDBY, Mode.LOCOMOTION), request)
    with playing(folder, *on_motors(folder, mode, lead=3.0)) as played:
        assert played.reach(mode)
        with monitor(played) as lidar:
            number = played.feed.newest()
            reported = lidar.report(2)
            until(lambda: played.mode() is (Mode.ZERO_TORQUE if mode is Mode.ZERO_TORQUE else Mode.DAMPING))
            until(lambda: any(status["level"] == 2 for status in played.feed.decode(played.feed.latest())["safety"]))
            sample = first_with_fault(played, number)
            if mode not in (Mode.ZERO_TORQUE, Mode.DAMPING):  # where the script damps meanwhile
                answer = played.operator.ask("load_a")
                assert not answer.granted
                assert "safety FAULT from lidar: blind" in answer.text
            lidar.report(0)
        log = played.finish()
    took = 1e-6 * (sample.stamp - reported)
    rows.append(("a monitor", "FAULT", mode.name, "motors", f"{expected(mode).name} after {took:.1f} ms"))
    judge(log, mode)


def test_a_watchdog_s_silence_damps(rows, folder):
    options = on_motors(folder, Mode.STANDBY, "--watchdog", "lidar:0.5", lead=30.0)
    with playing(folder, *options) as played:
        with monitor(played) as lidar:
            while played.mode() is not Mode.STANDBY:
                reported = lidar.report(0)
            lidar.process.kill()
            until(lambda: played.mode() is Mode.DAMPING)
        played.operator.ask("quit")
        log = played.finish()
    first = next(
        tick
        for tick in log.ticks
        if tick.output.control_mode.mode is Mode.DAMPING and "lidar" in tick.output.control_mode.status_message
    )
    assert first.output.control_mode.status_message.endswith("lidar: silent for more than 0.5 s (--watchdog)")
    assert reported > 0
    assert log.is_exact()


def expected(mode):
    return Mode.ZERO_TORQUE if mode is Mode.ZERO_TORQUE else Mode.DAMPING


def judge(log, mode):
    """From the first tick with the fault on the robot is damped, and the recording repeats bit for bit."""
    ticks = log.ticks
    first = next(i for i, tick in enumerate(ticks) if any(status.level == 2 for status in tick.input.safety))
    assert ticks[first - 1].output.control_mode.mode is mode
    assert ticks[first].output.control_mode.mode is expected(mode)
    if mode is not Mode.ZERO_TORQUE:
        assert not ticks[first].output.command.stiffness.any()
    assert log.is_exact()
