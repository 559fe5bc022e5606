"""The bridge as a program, by clients that know nothing of this project."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
import stranger
from dds_bridge import bridge, free_domain
from local_session import LocalSession, ticking
from stranger import Client, client, command, newest, until

from humanoid_sim.messages import Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickRecord
from humanoid_sim.mit import Extern

pytestmark = pytest.mark.soak

COMMAND = "rt/remote_policy_controller/command"


@dataclass
class Robot:
    """A session in REMOTE with a bridge, and a client in its domain."""

    local: LocalSession
    records: list[TickRecord]
    client: Client
    bridge: int
    """Process id."""

    def position(self):
        """Of the command in force; None where the joints are damped."""
        last = self.records[-1].output.command
        return float(last.position[0]) if last.stiffness.any() else None

    def writer(self):
        made = self.client.writer(COMMAND)
        until(made.get_matched_subscriptions, "the bridge's subscription")
        return made

    def wait_until_passive(self):
        until(lambda: self.position() is None, "the passive hold")
        until(lambda: self.local.data.owners["REMOTE"] == "", "nobody's turn")


@pytest.fixture(scope="module")
def robot():
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="hs-") as runtime:
        patch.setenv("XDG_RUNTIME_DIR", runtime)
        patch.setenv("ROS_DOMAIN_ID", str(free_domain()))
        local = LocalSession()
        with local.stack, client(int(os.environ["ROS_DOMAIN_ID"])) as joined, bridge() as process:
            local.enter_remote()
            with ticking(local, rig.PERIOD) as records:
                yield Robot(local, records, joined, process.pid)
            local.registration.close()
            assert process.wait(10.0) == 0, "it ends with the session"


@contextmanager
def streaming(writer, position):
    """Commands at 100 Hz, from a thread."""
    stop = threading.Event()

    def stream():
        while not stop.wait(0.01):
            writer.write(command(rig.JOINTS, position))

    thread = threading.Thread(target=stream)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_what_the_robot_does_is_seen(robot):
    joint_states = newest(robot.client.reader("rt/three/joint_states"))
    assert joint_states.name == ["shoulder", "elbow", "wrist"]
    assert (joint_states.position, len(joint_states.velocity), len(joint_states.effort)) == ([0.4, 0.5, 0.6], 3, 3)
    imu = newest(robot.client.reader("rt/imu/data"))
    assert (imu.header.frame_id, imu.orientation.w, imu.linear_acceleration.z) == ("imu", 1.0, pytest.approx(9.81))
    mode = newest(robot.client.reader("rt/control_mode"))
    assert (mode.mode, mode.controller_name) == (4, "remote_policy_controller")
    clock = robot.client.reader("rt/clock")
    assert newest(clock).clock.sec >= 10, "the robot's clock, which began at 10 s after the epoch"
    for pose in ("standby_controller", "standby_controller_a"):  # latched: the pose was reached before we came
        standby = newest(robot.client.reader(f"rt/{pose}/state"))
        assert (standby.is_finished, standby.current_segment, standby.total_segments) == (True, 1, 2)


def test_commands_are_obeyed_and_end(robot):
    writer = robot.writer()
    with streaming(writer, 0.25):
        until(lambda: robot.position() == 0.25, "the command")
        assert robot.local.data.owners["REMOTE"].startswith("dds ")
    robot.wait_until_passive()
    assert robot.records[-1].output.command.damping.tolist() == [6.5] * 3


def test_remote_belongs_to_one_client(robot):
    with streaming(robot.writer(), 0.1), streaming(robot.writer(), 0.9):
        refusal = re.compile(r"refused of (dds \S+): REMOTE: belongs to (dds \S+)")
        found = until(lambda: refusal.search("\n".join(robot.local.told)), "the refusal of one of them")
    assert found[1] != found[2]
    robot.wait_until_passive()


@pytest.mark.parametrize("header", [0, 3600])
def test_the_clients_clock_plays_no_part(robot, header):
    writer = robot.writer()
    ahead = time.time_ns() + header * 1_000_000_000
    sample = command(rig.JOINTS, 0.3)
    sample.header.stamp.sec = ahead // 1_000_000_000

    def is_obeyed():
        writer.write(sample, timestamp=ahead + time.monotonic_ns())
        return robot.position() == 0.3

    until(is_obeyed, "the command")
    robot.wait_until_passive()  # no stamp keeps it in force


def test_a_bridge_that_stood_still_brings_no_old_command(robot):
    writer = robot.writer()
    with streaming(writer, 0.4):
        until(lambda: robot.position() == 0.4, "the command")
        os.kill(robot.bridge, signal.SIGSTOP)
        time.sleep(0.5)  # what is sent meanwhile waits in the bridge's sockets
    time.sleep(0.5)
    assert robot.position() is None
    start = len(robot.records)
    os.kill(robot.bridge, signal.SIGCONT)
    time.sleep(0.3)
    assert [record for record in robot.records[start:] if record.output.command.stiffness.any()] == []
    with streaming(writer, 0.5):
        until(lambda: robot.position() == 0.5, "a command of now")
    robot.wait_until_passive()


HOSTILE = (
    lambda: command(("shoulder", "wrist", "elbow"), 0.1),
    lambda: command(("shoulder", "elbow"), 0.1),
    lambda: command([f"joint{i}" for i in range(2000)], 0.1),
    lambda: command(["x" * 3_000_000, "elbow", "wrist"], 0.1),
    lambda: command(rig.JOINTS, 0.1, velocity=[0.0] * 4),
    lambda: command(rig.JOINTS, 0.1, effort=[0.0, float("nan"), 0.0]),
    lambda: command(rig.JOINTS, 0.1, stiffness=[20.0, 20.0, -1.0]),
)


def test_hostile_samples_are_refused_and_no_honest_command_suffers(robot):
    honest, hostile = robot.writer(), robot.writer()
    with streaming(honest, 0.2):
        until(lambda: robot.position() == 0.2, "the honest command")
        start = len(robot.records)
        for make in HOSTILE:
            hostile.write(make())
        until(lambda: len(robot.records) > start + 20, "time to act on them")
        positions = {float(record.output.command.position[0]) for record in robot.records[start:]}
        assert positions <= {0.2, 0.4}, "the honest one's, or where the joints are damped"
    robot.wait_until_passive()


def test_every_source_of_a_safety_status_is_latched(robot):
    bad = SafetyStatus(SafetyLevel.WARNING, SafetyFlag.INVALID_FRAME, "can1", "frames of 3 bytes")
    robot.local.safety = (SafetyStatus(source="can0"), bad)
    until(lambda: len(robot.records[-1].input.safety) == 2, "the statuses")
    assert robot.records[-1].output.control_mode.mode is Mode.DAMPING
    reader = robot.client.reader("rt/safety_status", depth=10)
    heard = {}

    def both():
        heard.update({sample.source: (sample.level, sample.flags, sample.message) for sample in reader.take(10)})
        return len(heard) == 2

    until(both, "one status of each source")
    assert heard == {"can0": (0, 0, ""), "can1": (1, 32, "frames of 3 bytes")}
    robot.local.safety = (SafetyStatus(source="can0"),)
    until(lambda: both() and heard["can1"] == (0, 0, ""), "that can1 is heard of no more")


KEYS = "rt/piano/key_state"


def test_keys_that_the_session_makes_itself_are_published_and_not_taken(robot):
    robot.writer()
    assert robot.client.writer(KEYS).get_matched_subscriptions() == []
    reader = robot.client.reader(KEYS, depth=1)

    def pressed():
        robot.local.makes["key_pressed"] = Extern(np.array([0.0, 1.0]), robot.local.time)
        return [one.data for one in reader.take(1)]

    assert until(pressed, "the keys") == [[0.0, 1.0]]


def test_a_subscriber_that_stands_still_holds_nobody_up(robot):
    domain = os.environ["ROS_DOMAIN_ID"]
    script = f"import stranger, time; c = stranger.Client({domain}); r = c.reader('rt/clock'); "
    script += "stranger.newest(r); print(flush=True); time.sleep(600)"
    folder = str(Path(stranger.__file__).parent)
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, cwd=folder) as other:
        try:
            other.stdout.readline()
            other.send_signal(signal.SIGSTOP)
            reader = robot.client.reader("rt/clock")
            newest(reader)
            before = len(robot.records)
            until(lambda: len(robot.records) > before + 50, "a second of ticks")
            seconds = newest(reader).clock
            assert seconds.sec + 1e-9 * seconds.nanosec > robot.records[before].input.state.time
        finally:
            other.kill()


def test_another_domain_is_another_world(robot):
    here = int(os.environ["ROS_DOMAIN_ID"])
    with client(here % 100 + 1) as elsewhere:
        outside, inside = elsewhere.reader("rt/clock"), robot.client.reader("rt/clock")
        newest(inside)
        assert outside.take(10) == []
