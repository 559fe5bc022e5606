"""From a session's ticks to DDS, on the topics of the original stack."""

from __future__ import annotations

import time
from collections.abc import Set

from humanoid_sim.client import monotonic_ns
from humanoid_sim.frontends.attach import Attachment, Tick
from humanoid_sim.messages import SessionHeader
from humanoid_sim.recording.topics import ViewerTopics, topic_prefix
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Writer

_ACROSS = {ros.IMU_TOPIC, ros.CONTROL_MODE_TOPIC, ros.DESCRIPTION_TOPIC, ros.TF_TOPIC}
"""Topics that may leave the machine, beside the joint states: what shows the robot, nothing that safety needs."""


def served_topics(header: SessionHeader, *, is_local: bool) -> set[str]:
    """Return the topics of a session for its own machine, or for others; without those of live inputs."""
    names = _ACROSS | {ros.joint_states_topic(topic_prefix(header))}
    return names | {ros.SAFETY_TOPIC, *ros.STANDBY_TOPICS} if is_local else names


class Telemetry:
    """Publishes ticks. Never waits for a subscriber."""

    def __init__(
        self, attachment: Attachment, participant: Participant, *, is_local: bool, received: Set[str] = frozenset()
    ) -> None:
        """Announce the topics.

        Args:
            is_local: live inputs that the session makes itself, such as a simulated piano's keys, are published too.
            received: topics of live inputs that the bridge subscribes to.
        """
        self._participant = participant
        self._messages = ViewerTopics(attachment.header, every_state=True)
        self._topics = served_topics(attachment.header, is_local=is_local)
        self._writers: dict[tuple[str, str], Writer] = {}
        for topic in self._topics - {ros.SAFETY_TOPIC}:  # announced by its sources
            self._writer(topic, "")
        if is_local:
            self._topics |= set(self._messages.live.values()) - received

    def publish(self, tick: Tick) -> None:
        """Publish a tick, stamped with the time of day at which the session sent it."""
        time_ns = tick.stamp + time.time_ns() - monotonic_ns()
        for message in self._messages.messages(tick.record, time_ns):
            if message.topic in self._topics:
                self._writer(message.topic, message.source).write(message.data)

    def _writer(self, topic: str, source: str) -> Writer:
        """Return one for each source of a safety status, so that a late subscriber gets the latest of each."""
        if (topic, source) not in self._writers:
            self._writers[topic, source] = Writer(self._participant, topic)
        return self._writers[topic, source]
