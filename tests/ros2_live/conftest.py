"""Tests with real ROS 2 (`rclpy`), in an environment and in network namespaces of their own, by `make test-ros`."""

import sys
from pathlib import Path

import pytest

# The machines have a name for all test modules; importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))

from interface_package import variables
from machines import Machine, plug_in


@pytest.fixture(scope="session")
def messages():
    """The environment with all message types."""
    return variables()


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """The robot's computer."""
    with Machine(tmp_path_factory.mktemp("robot")) as machine:
        yield machine


@pytest.fixture(scope="module")
def host(robot, tmp_path_factory):
    """Another computer, at the other end of the robot's cable, and of a second one that nobody mentions."""
    with Machine(tmp_path_factory.mktemp("host"), beside=robot) as machine:
        plug_in(robot, machine)
        plug_in(robot, machine, "eth2", 8)
        yield machine
