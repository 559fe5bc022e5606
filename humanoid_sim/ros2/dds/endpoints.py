"""Writers and readers of topics whose samples are CDR bytes as they are on the wire.

Cyclone DDS's own serializer takes milliseconds for what this package's takes microseconds for, so the bytes go to the
layer below it.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from humanoid_sim.errors import InputError
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.definitions import message_fields
from humanoid_sim.ros2.topics import Topic, topic_kind


def dds_topic(topic: str) -> str:
    """Return the DDS name of a ROS 2 topic: `rt/control_mode` for `/control_mode`."""
    return f"rt{topic}"


def dds_type(schema: str) -> str:
    """Return the DDS name of a message type: `std_msgs::msg::dds_::Header_` for `std_msgs/msg/Header`."""
    package, kind, name = schema.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@cache
def idl_type(schema: str) -> Any:
    """Return a message type as Cyclone DDS's `IdlStruct`."""
    from cyclonedds.idl import make_idl_struct, types  # noqa: PLC0415 - an extra

    fields = {}
    for field in message_fields(schema):
        if "/" in field.kind:
            kind = idl_type(field.kind)
        else:
            kind = {"bool": bool, "string": str}.get(field.kind) or getattr(types, field.kind)
        if field.length is not None:
            kind = types.array[kind, field.length] if field.length else types.sequence[kind]
        fields[field.name] = kind
    return make_idl_struct(f"{schema.rpartition('/')[2]}_", dds_type(schema), fields)


def _described(participant: Participant, topic: str, kind: Topic) -> Any:
    from cyclonedds.topic import Topic as DdsTopic  # noqa: PLC0415 - an extra

    return DdsTopic(participant.entity, dds_topic(topic), idl_type(kind.schema))


def _qos(kind: Topic, depth: int, *, any_writer: bool = False) -> Any:
    from cyclonedds.qos import Policy, Qos  # noqa: PLC0415 - an extra

    is_latched = kind.latched and not any_writer
    reliable = Policy.Reliability.Reliable(max_blocking_time=0)  # no write waits for a reader that stopped reading
    return Qos(
        Policy.Reliability.BestEffort if any_writer else reliable,
        Policy.History.KeepLast(depth),
        Policy.Durability.TransientLocal if is_latched else Policy.Durability.Volatile,
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


class Writer:
    """Publishes on a topic, given by its ROS 2 name."""

    def __init__(self, participant: Participant, topic: str) -> None:
        from cyclonedds._clayer import ddspy_write  # noqa: PLC0415 - an extra; private, see above
        from cyclonedds.pub import DataWriter  # noqa: PLC0415

        kind = topic_kind(topic)
        self._writer = DataWriter(participant.entity, _described(participant, topic, kind), _qos(kind, kind.depth))
        self._put = ddspy_write

    def write(self, message: bytes) -> bool:
        """Send a message, as `humanoid_sim.ros2.messages` encodes it; True if sent. Never waits."""
        is_sent: bool = self._put(self._writer._ref, message + bytes(-len(message) % 4)) >= 0
        return is_sent


class Received(NamedTuple):
    """A sample that came."""

    data: bytes  # the whole message, with its encapsulation header
    writer: int  # handle of its writer


class Reader:
    """Subscribes to a topic. For one thread."""

    def __init__(
        self, participant: Participant, topic: str, depth: int, *, kind: Topic | None = None, any_writer: bool = False
    ) -> None:
        """Subscribe.

        Args:
            depth: messages that are kept between two calls of `take`.
            kind: type and quality of service, if not the topic's own.
            any_writer: match writers of whatever quality of service; else those that offer the topic's.
        """
        from cyclonedds._clayer import ddspy_take  # noqa: PLC0415 - an extra; private, see above
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet  # noqa: PLC0415
        from cyclonedds.sub import DataReader  # noqa: PLC0415

        self.topic, self._depth, kind = topic, depth, kind or topic_kind(topic)
        qos = _qos(kind, depth, any_writer=any_writer)
        self._reader = DataReader(participant.entity, _described(participant, topic, kind), qos)
        self._condition = ReadCondition(self._reader, ViewState.Any | InstanceState.Any | SampleState.Any)
        self._set = WaitSet(participant.entity)
        self._set.attach(self._condition)
        self._get = ddspy_take

    def wait(self, timeout: float) -> None:
        """Wait at most `timeout` s for a message."""
        self._set.wait(round(1e9 * timeout))

    def take(self) -> list[Received]:
        """Return the messages since the last call, oldest first.

        Raises `InputError` if the subscription does not work any more, which is not silence.
        """
        samples = self._get(self._reader._ref, self._condition.mask, self._depth)
        if isinstance(samples, int):
            raise InputError(f"{self.topic}: the subscription is broken (DDS error {samples})")
        return [Received(data, info.publication_handle) for data, info in samples if info.valid_data]
