"""Safety statuses from DDS, by a monitor that knows nothing of this project, with every quality of service."""

import os
import tempfile
import time
from contextlib import contextmanager

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from cyclonedds.core import Policy, Qos
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from dds_bridge import bridge, free_domain
from local_session import LocalSession, ticking
from stranger import Header, SafetyStatus, Time, client, until

from humanoid_sim.client import Intake
from humanoid_sim.messages import Mode
from humanoid_sim.messages import SafetyStatus as OwnStatus

RELIABLE, ANY = Policy.Reliability.Reliable(100_000_000), Policy.Reliability.BestEffort
QUALITIES = {
    "latched, as the robot's own": Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1)),
    "rclpy's default": Qos(RELIABLE, Policy.Durability.Volatile, Policy.History.KeepLast(10)),
    "best effort": Qos(ANY, Policy.Durability.Volatile, Policy.History.KeepLast(1)),
}


def status(level, source="lidar", message=""):
    return SafetyStatus(Header(Time(1, 2), ""), level, source, 0, message)


class Robot:
    """A session with a bridge, and a monitor in its domain."""

    def __init__(self, local, records, monitor):
        self.local, self.records, self.monitor = local, records, monitor

    @property
    def mode(self):
        return self.records[-1].output.control_mode.mode

    def stand_by(self):
        with Intake(self.local.info, "test") as intake:
            for word in ("damp", "load_a"):
                assert intake.ask(word).granted, word
        until(lambda: self.mode is Mode.STANDBY, "STANDBY")

    def ask(self, word):
        with Intake(self.local.info, "test") as intake:
            return intake.ask(word)

    def levels(self):
        return {one.source: int(one.level) for one in self.records[-1].input.safety}

    def writer(self, quality):
        topic = Topic(self.monitor.participant, "rt/safety_status", SafetyStatus)
        made = DataWriter(self.monitor.participant, topic, quality)
        until(made.get_matched_subscriptions, "the bridge's subscription")
        return made


@contextmanager
def running(early=None):
    """A session and its bridge; `early` is latched before the bridge is there."""
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="hs-") as runtime:
        patch.setenv("XDG_RUNTIME_DIR", runtime)
        patch.setenv("ROS_DOMAIN_ID", str(free_domain()))
        local = LocalSession()
        with local.stack, client(int(os.environ["ROS_DOMAIN_ID"])) as monitor:
            topic = Topic(monitor.participant, "rt/safety_status", SafetyStatus)
            before = DataWriter(monitor.participant, topic, QUALITIES["latched, as the robot's own"])
            if early is not None:
                before.write(early)
            with bridge(), ticking(local) as records:
                yield Robot(local, records, monitor)


@pytest.fixture(scope="module")
def robot():
    with running() as robot:
        yield robot


@pytest.mark.parametrize("quality", QUALITIES)
def test_a_fault_damps_whatever_its_quality_of_service_and_ok_clears_it(robot, quality):
    writer = robot.writer(QUALITIES[quality])
    robot.stand_by()
    writer.write(status(2, message="blind"))
    until(lambda: robot.mode is Mode.DAMPING, "DAMPING")
    until(lambda: robot.levels().get("lidar") == 2, "the source")
    assert robot.ask("load_a").text.startswith("DAMPING (damping_controller): LOAD_A refused: safety FAULT from lidar")
    writer.write(status(0, "fence"))
    writer.write(status(0))
    until(lambda: robot.levels().get("lidar") == 0, "its OK")
    assert robot.mode is Mode.DAMPING, "nothing recovers by itself"


def test_a_fault_that_lasts_for_a_moment_damps(robot):
    writer = robot.writer(QUALITIES["rclpy's default"])
    robot.stand_by()
    writer.write(status(1, "glitch"))
    writer.write(status(0, "glitch"))
    until(lambda: robot.mode is Mode.DAMPING, "DAMPING")
    until(lambda: robot.levels().get("glitch") == 0, "its OK")


def test_what_the_session_publishes_does_not_come_back(robot):
    reader = robot.monitor.reader("rt/safety_status", depth=100)
    robot.local.safety = (OwnStatus(2, 0, "can0", "down"),)
    until(lambda: [one for one in reader.take(100) if (one.source, one.level) == ("can0", 2)], "the robot's fault")
    robot.local.safety = (OwnStatus(source="can0"),)
    until(lambda: [one for one in reader.take(100) if (one.source, one.level) == ("can0", 0)], "its end")
    time.sleep(0.1)
    assert {name: level for name, level in robot.levels().items() if name.startswith("can0")} == {"can0": 0}
