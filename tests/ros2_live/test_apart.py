"""What leaves the robot's computer, and what gets in: seen from another one, at the other end of a cable."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from machines import CABLE, PROGRAMS, Machine, read_until, serve

pytestmark = pytest.mark.ros

ROBOT, HOST = "10.7.0.1", "10.7.0.2"
OUTSIDE = {"ROS_STATIC_PEERS": ROBOT}
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


class Packets:
    """Counts what arrives at the host from the robot's address."""

    def __init__(self, host: Machine) -> None:
        self._program = host.python(str(PROGRAMS / "packets.py"), CABLE, ROBOT)
        read_until(self._program, "ready")

    def count(self) -> int:
        assert self._program.stdin is not None
        assert self._program.stdout is not None
        self._program.stdin.write("\n")
        self._program.stdin.flush()
        return int(self._program.stdout.readline())


def open_ports(robot: Machine, host: Machine) -> list[int]:
    """Of all UDP ports that somebody listens on at the robot, those that the host can send to."""
    robot.run("sh", "-c", "echo 0 > /proc/sys/net/ipv4/icmp_ratelimit")  # every refusal is told
    listed = robot.run("ss", "-Huan").split("\n")
    ports = sorted({int(line.split()[3].rsplit(":", 1)[1]) for line in listed if line})
    assert ports
    assert min(ports) >= 7000
    found: list[int] = json.loads(host.run("python3", str(PROGRAMS / "ports.py"), ROBOT, *map(str, ports)))
    return found


@contextmanager
def ended(program: subprocess.Popen[str]) -> Iterator[None]:
    try:
        yield
    finally:
        program.terminate()
        program.communicate(timeout=20.0)


def test_the_services_stay_on_the_machine(robot: Machine, host: Machine, tmp_path: Path) -> None:
    profile = tmp_path / "DEFAULT_FASTDDS_PROFILES.xml"
    profile.write_text(OPEN_PROFILE)
    packets = Packets(host)
    with ended(serve(robot, tmp_path, FASTDDS_DEFAULT_PROFILES_FILE=str(profile), **ELSEWHERE)):
        assert json.loads(host.ask_ros("trigger.py", "list", "1", "3", environment=OUTSIDE)) == []
        assert packets.count() == 0
        assert open_ports(robot, host) == []
        found = robot.ask_ros("trigger.py", "list", "6", "10")
        assert len(json.loads(found)) == 6


def test_a_node_with_default_settings_does_not(robot: Machine, host: Machine) -> None:
    packets = Packets(host)
    program = robot.ros("trigger.py", "serve")
    read_until(program, "ready")
    with ended(program):
        assert json.loads(host.ask_ros("trigger.py", "list", "1", "10", environment=OUTSIDE)) != []
        assert packets.count() > 0
        assert 7410 in open_ports(robot, host)
