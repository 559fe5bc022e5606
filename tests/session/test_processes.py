"""The feed's readers and the intake's producers as processes: slow, stopped and killed."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
import rig

from humanoid_sim.client import DATA_HEAD, DATA_MAGIC, Feed
from humanoid_sim.session.pace import DurationHistogram

HEAD = "import sys, time\nfrom humanoid_sim.client import *\nsession = find_session(int(sys.argv[1]))\n"
READER = """
with Feed(session) as feed:
    print("ready", flush=True)
    while feed.is_running():
        for sample in feed.since(0):
            pass
        time.sleep({pause})
"""
PRODUCER = """
names = ("shoulder", "elbow", "wrist")
with Intake(session, "producer") as intake:
    print("ready", flush=True)
    while True:
        intake.velocity(0.5, 0.0, 0.0, deliberate=True)
        intake.remote(names, *[[0.25] * 3] * 5)
        time.sleep(0.01)
"""


@contextmanager
def program(text, *, niceness=0):
    """A Python program that attaches to this process's session, once it says that it is ready."""
    command = ["nice", "-n", str(niceness), sys.executable, "-c", HEAD + text, str(os.getpid())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "ready\n"
            yield process
        finally:
            process.kill()


@pytest.mark.soak
def test_readers_that_are_slow_stopped_or_killed_leave_the_feed_as_it_is(local):
    with (
        program(READER.format(pause=0)) as stopped,
        program(READER.format(pause=0.2)),
        program(READER.format(pause=0)) as killed,
    ):
        for i in range(300):
            local.tick()
            if i == 100:
                os.kill(stopped.pid, signal.SIGSTOP)
                killed.kill()
                killed.wait()
        with Feed(local.info) as feed:
            assert [sample.number for sample in feed.since(0)] == list(range(238, 301))
    assert local.feed.left_out == 0
    assert local.feed.path.exists()
    local.tick()
    with Feed(local.info) as feed:
        assert feed.newest() == 301


def until(local, condition):
    """Tick in real time until something is so."""
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(rig.PERIOD)
        local.time = time.monotonic()  # the robot's clock keeps real time here


@pytest.mark.soak
def test_what_a_killed_producer_commanded_ends_within_its_timeout(local):
    local.time = time.monotonic()
    local.enter_remote()
    ages = {"remote": 0.0, "velocity": 0.0}
    """s, of the oldest command that was still in force."""
    in_force = dict.fromkeys(ages, False)

    def tick():
        record = local.tick()
        state, remote = record.input.state, record.input.remote
        velocity = state.extern["velocity_command"]
        in_force["remote"] = bool(record.output.command.stiffness.any())
        in_force["velocity"] = bool(velocity.at(state.time).any())
        if in_force["remote"] and remote is not None:
            ages["remote"] = max(ages["remote"], float(state.time) - remote.arrival_time)
        if in_force["velocity"]:
            ages["velocity"] = max(ages["velocity"], float(state.time) - velocity.arrival_time)

    def ticked(condition):
        return lambda: tick() is None and condition()

    with program(PRODUCER) as producer:
        until(local, ticked(lambda: all(in_force.values())))
        producer.kill()
        producer.wait()
        until(local, ticked(lambda: not any(in_force.values())))
    assert 0.0 < ages["remote"] <= 0.1
    assert 0.0 < ages["velocity"] <= 0.25


def test_random_datagrams_do_nothing_worse_than_being_refused(local):
    generator = np.random.default_rng(7)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        for i in range(3000):
            path = (local.registration.data, local.registration.intents)[i % 2]
            data = generator.bytes(int(generator.integers(0, 300)))
            if i % 4 == 0:
                kind, name, topic = (int(generator.integers(0, limit)) for limit in (6, 20, 60))
                stamp = int(generator.integers(0, 2**63))
                data = DATA_HEAD.pack(DATA_MAGIC, kind, 0, name, topic, 1, stamp) + data
            try:
                client.sendto(data, str(path))
            except BlockingIOError:
                local.tick()
    record = local.tick()
    assert record.output.control_mode.controller_name == "zero_torque_controller"
    assert record.input.remote is None
    assert set(record.input.state.extern) <= {"velocity_command", "keys"}


def _tick_times(local, seconds):
    times = DurationHistogram()
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        begin = time.perf_counter()
        local.tick()
        times.add(time.perf_counter() - begin)
        time.sleep(0.005)
    return times


@pytest.mark.soak
def test_a_hundred_readers_cost_the_loop_no_more_than_as_many_processes_that_read_something_else(local):
    readers = READER.format(pause=0.02)
    others = 'data = bytes(400_000)\nprint("ready", flush=True)\nwhile True:\n    data[::7]\n    time.sleep(0.02)\n'
    p99 = {}
    for name, text in (("others", others), ("readers", readers)):
        with ExitStack() as stack:
            for _ in range(100):
                stack.enter_context(program(text, niceness=19))
            p99[name] = _tick_times(local, 8.0).percentile(99.0)
    assert p99["readers"] <= max(2.0 * p99["others"], 0.002)
    assert local.feed.left_out == 0
