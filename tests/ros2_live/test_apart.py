"""What leaves the robot's computer, and what gets in: seen from another one, at the other end of a cable."""

import json
import subprocess
import time
from contextlib import contextmanager

import pytest
from machines import CABLE, PROGRAMS, play, read_until, serve
from strangers import ACROSS, JOINTS, REMOTE, command, heard, is_passive, listen, passive_in_time, ticks_of, watch

pytestmark = pytest.mark.ros

ROBOT, HOST = "10.7.0.1", "10.7.0.2"
ROBOT_2 = "10.8.0.1"
"""At the cable that nobody mentions."""
OUTSIDE = {"ROS_STATIC_PEERS": f"{ROBOT};{ROBOT_2}"}
"""A stranger who knows where the robot is."""
ELSEWHERE = {
    "ROS_STATIC_PEERS": HOST,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
    "ROS_DISCOVERY_SERVER": f"{HOST}:11811",
    "FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA",
}
"""What somebody may have set for nodes that are meant for others."""
OPEN_PROFILE = """
<dds><profiles xmlns="http://www.eprosima.com"><participant profile_name="all" is_default_profile="true">
<rtps><useBuiltinTransports>true</useBuiltinTransports></rtps></participant></profiles></dds>
"""


def watched(host, device=CABLE, address=ROBOT):
    """A program that counts what arrives at the host from the robot's address."""
    program = host.python(str(PROGRAMS / "packets.py"), device, address)
    read_until(program, "ready")
    return program


def count(packets):
    return int(packets.communicate("\n", timeout=20.0)[0])


@contextmanager
def ended(program):
    """Ends a program afterwards; one that hangs in ending would be heard in later tests."""
    try:
        yield
    finally:
        program.terminate()
        try:
            program.communicate(timeout=20.0)
        except subprocess.TimeoutExpired:
            program.kill()
            raise


def test_the_services_stay_on_the_machine(robot, host, tmp_path):
    profile = tmp_path / "DEFAULT_FASTDDS_PROFILES.xml"
    profile.write_text(OPEN_PROFILE)
    packets = watched(host)
    with ended(serve(robot, tmp_path, FASTDDS_DEFAULT_PROFILES_FILE=str(profile), **ELSEWHERE)):
        assert json.loads(host.ask_ros("trigger.py", "list", "1", "3", environment=OUTSIDE)) == []
        assert count(packets) == 0
        found = robot.ask_ros("trigger.py", "list", "6", "10")
        assert len(json.loads(found)) == 6


# The bridge. A session in REMOTE, on the robot's computer.


def in_remote(robot, *options):
    program = play(robot, *options, script="damp; load_a; wait; start_remote; hold 300")
    read_until(program, "STANDBY → REMOTE")
    return program


def test_by_default_nothing_crosses(robot, host, messages):
    packets = [watched(host), watched(host, "eth2", ROBOT_2)]
    with ended(in_remote(robot, "--dds")), ended(command(host, messages, 0.3, **OUTSIDE)):
        outside = heard(listen(host, messages, 4.0, **OUTSIDE))
        assert sum(outside["counts"].values()) == 0
        assert set(outside["writers"].values()) == {0}
        assert [tick for tick in ticks_of(watch(robot, 0.5)) if tick["arrival"] is not None] == []
        assert [*map(count, packets)] == [0, 0]
        inside = heard(listen(robot, messages, 1.0, until=ACROSS))
        assert [topic for topic in ACROSS if not inside["counts"][topic]] == []


@pytest.fixture(scope="class")
def opened(robot, host):
    """With a bridge on the cable's interface, too."""
    session = in_remote(robot, "--dds", CABLE)
    with ended(session):
        yield session


@pytest.mark.usefixtures("opened")
class TestOpened:
    def test_five_topics_go_out_and_no_more_and_the_services_stay(self, robot, host, messages):
        packets = [watched(host), watched(host, "eth2", ROBOT_2)]
        told = heard(listen(host, messages, 4.0, until=ACROSS))
        for counted in ("counts", "writers"):
            assert sorted(topic for topic, count in told[counted].items() if count) == sorted(ACROSS)
        assert told["last"]["/control_mode"][""]["mode"] == REMOTE
        mentioned, other = map(count, packets)
        assert mentioned > 0 == other
        with ended(serve(robot)):
            assert json.loads(host.ask_ros("trigger.py", "list", "1", "3", environment=OUTSIDE)) == []

    def test_a_node_on_the_robot_is_served_once(self, robot, messages):
        told = heard(listen(robot, messages, 4.0, until=ACROSS))
        assert {topic: told["writers"][topic] for topic in ACROSS} == dict.fromkeys(ACROSS, 1)
        assert told["counts"]["/robot_description"] == 1

    def test_commands_come_in_until_the_cable_is_pulled(self, robot, host, messages, opened):
        with ended(command(host, messages, 0.3)):
            read_until(opened, "remote commands arrive and are in force")
            watching = watch(robot, 4.0)
            time.sleep(2.0)
            host.run("ip", "link", "set", CABLE, "down")
            pulled = time.monotonic()
            fed = ticks_of(watching)
            obeyed = [tick for tick in fed if not is_passive(tick)]
            assert obeyed
            assert {tuple(tick["position"]) for tick in obeyed} == {(0.3,) * len(JOINTS)}
            assert passive_in_time(fed)
            after = [tick for tick in fed if tick["stamp"] > pulled + 0.5]
            assert after
            assert all(is_passive(tick) and tick["mode"] == REMOTE for tick in after)
            # Plugged in again, it goes on by itself: REMOTE never ended.
            host.run("ip", "link", "set", CABLE, "up")
            read_until(opened, "remote commands arrive and are in force")
        assert heard(listen(host, messages, 1.0, until=ACROSS))["counts"]["/lite/joint_states"] > 0
