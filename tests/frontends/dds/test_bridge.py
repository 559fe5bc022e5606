"""The bridge as a program, by clients that know nothing of this project."""

import os
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
from cyclonedds.core import Policy, Qos
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from dds_bridge import bridge, free_domain
from local_session import LocalSession, ticking
from stranger import Client, Header, Time, client, command, newest, until
from stranger import SafetyStatus as Status

from humanoid_sim.client import Intake
from humanoid_sim.messages import Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickRecord

COMMAND, SAFETY = "rt/remote_policy_controller/command", "rt/safety_status"
RELIABLE, ANY = Policy.Reliability.Reliable(100_000_000), Policy.Reliability.BestEffort
QUALITIES = {
    "latched, as the robot's own": Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1)),
    "rclpy's default": Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(10)),
    "best effort": Qos(ANY, Policy.Durability.Volatile, Policy.History.KeepLast(1)),
}


@dataclass
class Robot:
    """A session in REMOTE with a bridge, and a client in its domain."""

    local: LocalSession
    records: list[TickRecord]
    client: Client
    bridge: int
    """Process id."""

    @property
    def mode(self):
        return self.records[-1].output.control_mode.mode

    def position(self):
        """Of the command in force; None where the joints are damped."""
        last = self.records[-1].output.command
        return float(last.position[0]) if last.stiffness.any() else None

    def levels(self):
        return {one.source: int(one.level) for one in self.records[-1].input.safety}

    def ask(self, *words):
        with Intake(self.local.info, "test") as intake:
            return [intake.ask(word) for word in words][-1]

    def stand_by(self):
        assert self.ask("damp", "load_a").granted
        until(lambda: self.mode is Mode.STANDBY, "STANDBY")

    def commander(self):
        made = self.client.writer(COMMAND)
        until(made.get_matched_subscriptions, "the bridge's subscription")
        return made

    def monitor(self, quality):
        participant = self.client.participant
        made = DataWriter(participant, Topic(participant, SAFETY, Status), QUALITIES[quality])
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
    assert abs(mode.header.stamp.sec - time.time()) < 60.0
    standby = newest(robot.client.reader("rt/standby_controller_a/state"))  # latched: it was reached before we came
    assert (standby.is_finished, standby.current_segment, standby.total_segments) == (True, 1, 2)


def test_commands_of_one_client_are_obeyed_and_end(robot):
    with streaming(robot.commander(), 0.25):
        until(lambda: robot.position() == 0.25, "the command")
        assert robot.local.data.owners["REMOTE"].startswith("dds ")
        with streaming(robot.commander(), 0.9):
            until(lambda: "REMOTE: belongs to dds" in "\n".join(robot.local.told), "the refusal of another one")
        assert robot.position() == 0.25
    robot.wait_until_passive()
    assert robot.records[-1].output.command.damping.tolist() == [6.5] * 3


def test_hostile_samples_are_refused_and_no_honest_command_suffers(robot):
    honest, hostile = robot.commander(), robot.commander()
    with streaming(honest, 0.2):
        until(lambda: robot.position() == 0.2, "the honest command")
        start = len(robot.records)
        hostile.write(command(["x" * 3_000_000, "elbow", "wrist"], 0.1))
        hostile.write(command(rig.JOINTS, 0.1, effort=[0.0, float("nan"), 0.0]))
        until(lambda: len(robot.records) > start + 20, "time to act on them")
        positions = {float(record.output.command.position[0]) for record in robot.records[start:]}
        assert positions <= {0.2, 0.4}, "the honest one's, or where the joints are damped"
    robot.wait_until_passive()


def status(level, source="lidar", message=""):
    return Status(Header(Time(1, 2), ""), level, source, 0, message)


@pytest.mark.parametrize("quality", QUALITIES)
def test_a_fault_damps_whatever_its_quality_of_service_and_ok_clears_it(robot, quality):
    writer = robot.monitor(quality)
    robot.stand_by()
    writer.write(status(2, message="blind"))
    until(lambda: robot.mode is Mode.DAMPING, "DAMPING")
    until(lambda: robot.levels().get("lidar") == 2, "the source")
    assert "LOAD_A refused: safety FAULT from lidar" in robot.ask("load_a").text
    writer.write(status(0))
    until(lambda: robot.levels().get("lidar") == 0, "its OK")
    assert robot.mode is Mode.DAMPING, "nothing recovers by itself"


def test_each_source_is_latched_and_what_the_session_publishes_does_not_come_back(robot):
    bad = SafetyStatus(SafetyLevel.WARNING, SafetyFlag.INVALID_FRAME, "can1", "frames of 3 bytes")
    robot.local.robot.safety = (SafetyStatus(source="can0"), bad)
    until(lambda: robot.levels().get("can1") == 1, "the status")
    reader, received = robot.client.reader(SAFETY, depth=10), {}

    def both(level):
        received.update({one.source: (one.level, one.flags, one.message) for one in reader.take(10)})
        return "can0" in received and received.get("can1", (-1,))[0] == level

    until(lambda: both(1), "one status of each source")
    assert (received["can0"], received["can1"]) == ((0, 0, ""), (1, 32, "frames of 3 bytes"))
    robot.local.robot.safety = (SafetyStatus(source="can0"),)
    until(lambda: both(0), "the end of can1's")
    assert "can1" not in robot.levels()
