"""From a session's ticks to DDS, on the topics of the original stack."""

from __future__ import annotations

from collections.abc import Set

from humanoid_sim.frontends.attach import Attachment, Tick
from humanoid_sim.recording.topics import TopicMessage, ViewerTopics, topic_prefix
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.cdr import encode
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.definitions import CLOCK
from humanoid_sim.ros2.messages import stamp

_ACROSS = {ros.IMU_TOPIC, ros.CONTROL_MODE_TOPIC, ros.DESCRIPTION_TOPIC, ros.TF_TOPIC, ros.TF_STATIC_TOPIC}
"""Topics that may leave the machine, beside the joint states: what shows the robot, nothing that safety needs."""


def served_topics(attachment: Attachment, *, is_local: bool) -> set[str]:
    """Return the topics of a session for its own machine, or for others; without those of live inputs."""
    names = _ACROSS | {ros.joint_states_topic(topic_prefix(attachment.header))}
    if is_local:
        names |= {ros.SAFETY_TOPIC, ros.STANDBY_TOPIC, *ros.STANDBY_TOPICS}
        names |= set() if attachment.is_hardware else {ros.CLOCK_TOPIC}
    return names


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
        self._attachment, self._participant = attachment, participant
        self._messages = ViewerTopics(attachment.header, every_state=True)
        self._topics = served_topics(attachment, is_local=is_local)
        self._writers: dict[tuple[str, str], Writer] = {}
        for topic in self._topics - {ros.SAFETY_TOPIC}:  # announced by its sources
            self._writer(topic, "")
        if is_local:
            self._topics |= set(self._messages.live.values()) - received

    def publish(self, tick: Tick) -> None:
        """Publish a tick."""
        start_time_ns = self._attachment.status().get("start_time_ns", self._attachment.header.start_time_ns)
        time_ns = start_time_ns + round(1e9 * float(tick.record.input.state.time))
        self._put(TopicMessage(ros.CLOCK_TOPIC, encode(CLOCK, stamp(time_ns))))
        for message in self._messages.messages(tick.record, time_ns):
            self._put(message)
            if message.topic in ros.STANDBY_TOPICS:
                self._put(message._replace(topic=ros.STANDBY_TOPIC))

    def _put(self, message: TopicMessage) -> None:
        if message.topic in self._topics:
            self._writer(message.topic, message.source).write(message.data)

    def _writer(self, topic: str, source: str) -> Writer:
        """Return one for each source of a safety status, so that a late subscriber gets the latest of each."""
        if (topic, source) not in self._writers:
            self._writers[topic, source] = Writer(self._participant, topic)
        return self._writers[topic, source]
