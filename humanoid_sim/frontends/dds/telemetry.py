"""From the feed to DDS: what a session tells, on the topics of the original stack."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from humanoid_sim.client import Sample
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.dds.commands import wanted_inputs
from humanoid_sim.messages import TickRecord
from humanoid_sim.recording.topics import TopicMessage, ViewerTopics, topic_prefix
from humanoid_sim.ros2 import topics as ros
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Writer
from humanoid_sim.ros2.definitions import CLOCK, JOINT_STATE
from humanoid_sim.ros2.messages import encode_clock, encode_control_mode

_ACROSS = (ros.IMU_TOPIC, ros.CONTROL_MODE_TOPIC, ros.DESCRIPTION_TOPIC, ros.TF_TOPIC, ros.TF_STATIC_TOPIC)
"""The topics that may leave the machine, beside the joint states: what shows the robot, nothing that safety needs."""


def served_topics(attachment: Attachment, *, is_local: bool) -> dict[str, ros.Topic]:
    """Return the topics of a session for its own machine, or for others, by name.

    The clock is a simulation's. Topics of live inputs are not among them: see `Telemetry`.
    """
    names = [*_ACROSS]
    if is_local:
        names += [ros.SAFETY_TOPIC, ros.STANDBY_TOPIC, *ros.STANDBY_TOPICS]
    if is_local and not attachment.session.hardware:
        names.append(ros.CLOCK_TOPIC)
    joint_states = ros.joint_states_topic(topic_prefix(attachment.header))
    return {joint_states: ros.Topic(JOINT_STATE), **{name: ros.TOPICS[name] for name in names}}


class Telemetry:
    """Publishes ticks. Never waits for a subscriber."""

    def __init__(
        self,
        attachment: Attachment,
        participant: Participant,
        topics: Mapping[str, ros.Topic],
        *,
        live: bool = False,
        news: Callable[[], str] = lambda: "",
    ) -> None:
        """Announce the topics.

        Args:
            live: whether live inputs that the session makes itself, such as a simulated piano's keys, are published as
                well, each on its topic as of its first value. Those that it takes from outside are not: the bridge
                subscribes to their topics.
            news: what to say in `/control_mode` beside the session's own status message; empty for nothing.
        """
        self._attachment, self._participant, self._news = attachment, participant, news
        self._fixed = dict(topics)
        self._messages = ViewerTopics(attachment.header, every_state=True)
        self._writers: dict[tuple[str, str], Writer] = {}
        taken = {one.topic for one in wanted_inputs(attachment).values()}
        made = set(self._messages.live.values()) - taken if live else ()
        self._topics = {**self._fixed, **dict.fromkeys(made, ros.LIVE_INPUT)}
        for topic in self._fixed:
            if topic != ros.SAFETY_TOPIC:  # announced by its sources
                self._writer(topic, "")

    def publish(self, sample: Sample) -> None:
        """Publish a tick."""
        record = self._attachment.record(sample)
        time_ns = self._attachment.time_ns(float(record.input.state.time))
        if ros.CLOCK_TOPIC in self._topics:
            self._put(TopicMessage(ros.CLOCK_TOPIC, CLOCK, encode_clock(time_ns)))
        for message in self._messages.messages(record, time_ns):
            if message.topic == ros.CONTROL_MODE_TOPIC:
                self._put(message._replace(data=self._control_mode(record, time_ns, message.data)))
            else:
                self._put(message)
            if message.topic in ros.STANDBY_TOPICS:
                self._put(message._replace(topic=ros.STANDBY_TOPIC))

    def _control_mode(self, record: TickRecord, time_ns: int, message: bytes) -> bytes:
        news = self._news()
        if not news:
            return message
        told = record.output.control_mode
        words = [word for word in (told.status_message, news) if word]
        return encode_control_mode(time_ns, replace(told, status_message="; ".join(words)))

    def _put(self, message: TopicMessage) -> None:
        if message.topic in self._topics:
            self._writer(message.topic, message.source).write(message.data)

    def _writer(self, topic: str, source: str) -> Writer:
        """One for each source of a safety status, so that a late subscriber gets the latest of each."""
        writer = self._writers.get((topic, source))
        if writer is None:
            writer = self._writers[topic, source] = Writer(self._participant, topic, self._topics[topic])
        return writer
