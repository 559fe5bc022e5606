"""How long a command takes from a client's write to the motors, at 200 Hz."""

import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from stranger import client, command, until

from humanoid_sim.client import Feed, SessionError, find_session, monotonic_ns
from humanoid_sim.messages import Mode
from humanoid_sim.robots.description import load_robot

_COMMANDS = 1000
"""At 200 Hz."""


@pytest.mark.slow
def test_from_a_clients_write_to_the_motors(domain, runtime):
    script = "damp; load_b; wait; start_remote; hold 600"
    options = ("--dds", "--pace", "realtime", "--viewer", "none", "--video", "none", "--record", "none")
    play = subprocess.Popen([sys.executable, "-m", "humanoid_sim.play", *options, "--script", script])
    try:
        with Feed(until(_session, "the session", 60.0)) as feed, client(domain) as joined:
            latencies = _latencies(feed, joined)
    finally:
        play.terminate()
        play.wait(60.0)
    milliseconds = 1e-6 * np.array(latencies)
    print(
        f"\nwrite to motor command: {len(milliseconds)} of {_COMMANDS}, median {np.median(milliseconds):.2f} ms, "
        f"99 % {np.percentile(milliseconds, 99):.2f} ms, max {milliseconds.max():.2f} ms"
    )
    assert len(milliseconds) > 0.5 * _COMMANDS, "a tick takes the newest; two commands may fall into one"
    assert milliseconds.min() > 0.0


def _session():
    try:
        return find_session()
    except SessionError:
        return None


def _mode(feed):
    """None before the first tick."""
    sample = feed.latest()
    return None if sample is None else int(feed.decode(sample)["mode"])


def _latencies(feed, joined):
    """Of each command that was seen at the motors, ns: each has an effort of its own."""
    joints = load_robot("lite").joint_names
    writer = joined.writer("rt/remote_policy_controller/command")
    until(writer.get_matched_subscriptions, "the bridge", 60.0)
    until(lambda: _mode(feed) == Mode.REMOTE, "REMOTE", 60.0)
    sent = {}
    seen = {}
    begun, number = monotonic_ns(), feed.newest()
    for count in range(1, _COMMANDS + 1):
        sample = command(joints, 0.0, effort=[1e-6 * count] + [0.0] * 13)
        due = begun + count * 5_000_000
        time.sleep(max(1e-9 * (due - monotonic_ns()), 0.0))
        sent[count] = monotonic_ns()
        writer.write(sample)
        for tick in feed.since(number):
            number = tick.number
            effort = float(feed.decode(tick)["command_effort"][0])
            seen.setdefault(round(1e6 * effort), tick.stamp)
    return [stamp - sent[count] for count, stamp in seen.items() if count in sent]
