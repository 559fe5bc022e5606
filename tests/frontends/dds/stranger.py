"""A client with raw Cyclone DDS, whose decoder reads what the package's encoder wrote."""

from collections.abc import Sequence
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from waiting import until

from humanoid_sim.ros2.dds.endpoints import dds_topic, idl_type
from humanoid_sim.ros2.topics import topic_kind

RELIABLE = Policy.Reliability.Reliable(100_000_000)


def header() -> Any:
    """Stamped long ago: the stamp plays no part."""
    return idl_type("std_msgs/msg/Header")(idl_type("builtin_interfaces/msg/Time")(1, 2), "anywhere")


class Client:
    """A participant in a domain; its endpoints are given by the ROS 2 names of their topics."""

    def __init__(self, participant: DomainParticipant) -> None:
        self._participant = participant

    def _topic(self, name: str) -> Topic:
        return Topic(self._participant, dds_topic(name), idl_type(topic_kind(name).schema))

    def reader(self, name: str) -> DataReader:
        latched = Policy.Durability.TransientLocal if topic_kind(name).latched else Policy.Durability.Volatile
        return DataReader(self._participant, self._topic(name), Qos(RELIABLE, latched, Policy.History.KeepLast(10)))

    def writer(self, name: str, *quality: Any) -> DataWriter:
        """A writer that somebody reads."""
        made = DataWriter(self._participant, self._topic(name), Qos(*quality or (RELIABLE, Policy.History.KeepLast(4))))

        def is_matched() -> bool:
            try:
                return bool(made.get_matched_subscriptions())
            except IndexError:  # the library's, where somebody joins while it counts
                return False

        until(is_matched)
        return made


def newest(reader: DataReader) -> Any:
    """The newest sample, once there is one."""
    return until(lambda: reader.take(1000)[-1:])[0]


def command(names: Sequence[str], position: float = 0.0, **fields: Sequence[float]) -> Any:
    """A command that holds all joints at a position."""
    count = len(names)
    values = {
        "position": [position] * count,
        "velocity": [0.0] * count,
        "effort": [0.0] * count,
        "stiffness": [20.0] * count,
        "damping": [1.0] * count,
    }
    return idl_type("humanoid_control_msgs/msg/MITCommand")(header(), list(names), **{**values, **fields})
