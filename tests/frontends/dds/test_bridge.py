"""The bridge as a program between a session, raw Cyclone DDS and this project's own client."""

import re
import tempfile
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

import rig
from cyclonedds.core import Policy
from dds_bridge import bridge, free_domain
from local_session import LocalSession, ticking
from stranger import RELIABLE, Client, command, header, newest
from waiting import until

from humanoid_sim.client import Intake
from humanoid_sim.dds_client import RobotClient
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.frontends.dds.telemetry import served_topics
from humanoid_sim.messages import ControlMode, Mode, SafetyFlag, SafetyLevel, SafetyStatus, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.ros2.dds.endpoints import Writer, idl_type
from humanoid_sim.ros2.definitions import FLOAT32_MULTI_ARRAY, SAFETY_STATUS
from humanoid_sim.ros2.messages import encode_control_mode, encode_safety_status
from humanoid_sim.stack import run_header

COMMAND, SAFETY, KEYS = "/remote_policy_controller/command", "/safety_status", "/piano/key_state"


@dataclass
class Robot:
    """A session in REMOTE with a bridge, and clients in its domain."""

    local: LocalSession
    records: list[TickRecord]
    ours: RobotClient
    client: Client

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

    def wait_until_passive(self):
        until(lambda: self.position() is None)
        until(lambda: self.local.data.owners["REMOTE"] == "")


@pytest.fixture(scope="module")
def robot():
    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="hs-") as runtime:
        patch.setenv("XDG_RUNTIME_DIR", runtime)
        patch.setenv("ROS_DOMAIN_ID", str(free_domain()))
        local = LocalSession(takes={"key_pressed": 3})
        local.robot.safety = (SafetyStatus(source="can0"),)
        with local.stack, RobotClient("three") as ours, bridge() as process:
            local.enter_remote()
            with ticking(local, rig.PERIOD) as records:
                yield Robot(local, records, ours, Client(ours._participant.entity))
            local.registration.close()
            assert process.wait(60.0) == 0, "it ends with the session"


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
    joint_states = newest(robot.client.reader("/three/joint_states"))
    assert joint_states.name == ["shoulder", "elbow", "wrist"]
    assert (joint_states.position, len(joint_states.velocity), len(joint_states.effort)) == ([0.4, 0.5, 0.6], 3, 3)
    imu = newest(robot.client.reader("/imu/data"))
    assert (imu.header.frame_id, imu.orientation.w, imu.linear_acceleration.z) == ("imu", 1.0, pytest.approx(9.81))
    control_mode = robot.client.reader("/control_mode")
    until(lambda: newest(control_mode).controller_name == "remote_policy_controller")
    mode = newest(control_mode)
    assert mode.mode == 4
    assert abs(mode.header.stamp.sec - time.time()) < 600.0
    standby = robot.client.reader("/standby_controller_a/state")  # latched: the pose was reached before we came
    until(lambda: [(one.is_finished, one.total_segments) for one in standby.take(10)[-1:]] == [(True, 2)])


def test_a_client_of_this_project_reads_the_robot_and_commands_it(robot):
    ones = np.ones(3)
    wanted = MITCommand(0.3 * ones, 0.0 * ones, 0.1 * ones, 20.0 * ones, ones)
    state = until(lambda: robot.ours.state(0.1))
    assert robot.ours.joint_names == state.names == ("shoulder", "elbow", "wrist")
    assert state.position.tolist() == [0.4, 0.5, 0.6]
    assert until(lambda: robot.ours.state(0.1)).time_ns > state.time_ns
    until(lambda: until(robot.ours.control_mode).mode is Mode.REMOTE)
    assert until(robot.ours.imu).quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    until(lambda: until(robot.ours.standby).is_finished)
    assert until(robot.ours.safety) == {"can0": SafetyStatus(source="can0")}
    with pytest.raises(FieldError, match=r"has shape \(2,\), expected \(3,\)"):
        robot.ours.command(MITCommand.zeros(2))

    def obeyed():
        assert robot.ours.command(wanted)
        robot.ours.state(0.05)
        return robot.records[-1].output.command.effort.tolist() == [0.1] * 3

    until(obeyed)
    robot.wait_until_passive()


def test_commands_of_one_client_are_obeyed_until_they_end_whatever_others_send(robot):
    honest, hostile = robot.client.writer(COMMAND), robot.client.writer(COMMAND)
    with streaming(honest, 0.2):
        until(lambda: robot.position() == 0.2)
        start = len(robot.records)
        hostile.write(command(["x" * 3_000_000, "elbow", "wrist"], 0.1))
        hostile.write(command(rig.JOINTS, 0.1, effort=[0.0, float("nan"), 0.0]))
        until(lambda: len(robot.records) > start + 20)
        positions = {float(record.output.command.position[0]) for record in robot.records[start:]}
        assert positions <= {0.2, 0.4}, "the honest one's, or where the joints are damped"
        with streaming(hostile, 0.9):
            until(lambda: re.search(r"refused of dds .*REMOTE: belongs to dds", "\n".join(robot.local.told)))
    robot.wait_until_passive()
    assert robot.records[-1].output.command.damping.tolist() == [6.5] * 3


def test_keys_from_outside_reach_the_session_where_it_takes_them(robot):
    newest(robot.client.reader("/control_mode"))
    reader = robot.client.reader(KEYS)
    assert reader.get_matched_publications() == [], "never both"
    writer = robot.client.writer(KEYS)

    def pressed():
        extern, time = robot.records[-1].input.state.extern, robot.records[-1].input.state.time
        return extern["key_pressed"].at(time).tolist() if "key_pressed" in extern else []

    def write(*keys):
        layout = idl_type("std_msgs/msg/MultiArrayLayout")([], 0)
        writer.write(idl_type(FLOAT32_MULTI_ARRAY)(layout, keys))
        return pressed()

    until(lambda: write(1.0, 0.0, 1.0) == [1.0, 0.0, 1.0])
    write(*[1.0] * 88)
    until(lambda: pressed() == [0.0] * 3)  # after the timeout of what was not repeated


@pytest.mark.parametrize(
    "quality",
    [
        (RELIABLE, Policy.Durability.TransientLocal),  # latched, as the robot's own
        (RELIABLE, Policy.Durability.Volatile),  # rclpy's default
        (Policy.Reliability.BestEffort, Policy.Durability.Volatile),
    ],
    ids=["latched", "reliable", "best effort"],
)
def test_a_fault_damps_whatever_its_quality_of_service_and_ok_clears_it(robot, quality):
    writer = robot.client.writer(SAFETY, *quality)

    def report(level):
        writer.write(idl_type(SAFETY_STATUS)(header(), level, "lidar", 0, ""))
        return robot.levels().get("lidar") == level

    assert robot.ask("damp", "load_a").granted
    until(lambda: robot.mode is Mode.STANDBY)
    until(lambda: report(2))
    until(lambda: robot.mode is Mode.DAMPING)
    assert "LOAD_A refused: safety FAULT from lidar" in robot.ask("load_a").text
    until(lambda: report(0))
    assert robot.mode is Mode.DAMPING, "nothing recovers by itself"


def test_each_source_is_latched_and_what_the_session_publishes_does_not_come_back(robot):
    bad = SafetyStatus(SafetyLevel.WARNING, SafetyFlag.INVALID_FRAME, "can1", "frames of 3 bytes")
    robot.local.robot.safety = (SafetyStatus(source="can0"), bad)
    until(lambda: robot.levels().get("can1") == 1)
    reader, received = robot.client.reader(SAFETY), {}

    def both(level):
        received.update({one.source: (one.level, one.flags, one.message) for one in reader.take(10)})
        return "can0" in received and received.get("can1", (-1,))[0] == level

    until(lambda: both(1))
    assert (received["can0"], received["can1"]) == ((0, 0, ""), (1, 32, "frames of 3 bytes"))
    robot.local.robot.safety = (SafetyStatus(source="can0"),)
    until(lambda: both(0))
    assert "can1" not in robot.levels()


def test_safety_and_standby_stay_on_the_machine():
    neck = run_header(load_robot("lite_neck"), 0.02, None, settings={})
    across = {"/lite/joint_states", "/imu/data", "/control_mode", "/robot_description", "/tf"}
    assert served_topics(neck, is_local=False) == across, "the prefix of all Lites"
    own = {"/standby_controller_a/state", "/standby_controller_b/state", "/safety_status"}
    assert served_topics(neck, is_local=True) == across | own


def test_what_is_not_known_is_said_and_a_broken_subscription_is_no_silence():
    with RobotClient("three", domain=free_domain()) as robot:
        assert (robot.state(timeout=0.0), robot.joint_names, robot.description()) == (None, (), None)
        assert (robot.control_mode(), robot.imu(), robot.standby(), robot.safety()) == (None, None, None, {})
        with pytest.raises(FieldError, match=r"has shape \(3,\), expected \(0,\), one value per joint of the robot's"):
            robot.command(MITCommand.zeros(3))
        mode = Writer(robot._participant, "/control_mode")
        safety = Writer(robot._participant, SAFETY)
        beyond = SimpleNamespace(level=9, source="a", flags=1 << 31, message="")
        safety.write(encode_safety_status(0, beyond))
        assert until(robot.safety)["a"].level is SafetyLevel.CRITICAL
        later = bytearray(encode_control_mode(0, ControlMode(Mode.REMOTE, "new")))
        later[4 + 8 + 5] = 7  # behind the encapsulation, the stamp and an empty frame
        mode.write(bytes(later))
        with pytest.raises(InputError, match=r"^/control_mode: 7 is not a valid Mode"):
            until(robot.control_mode)
        robot.close()
        with pytest.raises(InputError, match=r"^/control_mode: the subscription is broken \(DDS error -\d+\)"):
            robot.control_mode()


@pytest.mark.parametrize("text", ["-1", "233", "seven", "1.5", "٣"])
def test_a_domain_that_is_none_is_refused(text, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(InputError, match=rf"^ROS_DOMAIN_ID: is '{text}', expected a whole number from 0 to 232$"):
        RobotClient("lite")
