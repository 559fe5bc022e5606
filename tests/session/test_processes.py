"""The feed's readers and the intake's producers as processes: slow, stopped and killed."""

import os
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
import rig

from humanoid_sim.client import DATA_HEAD, DATA_MAGIC

HEAD = "import sys, time\nfrom humanoid_sim.client import *\nsession = find_session(int(sys.argv[1]))\n"
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
            path = local.registration.path / ("data", "intents")[i % 2]
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
