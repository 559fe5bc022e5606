"""Topics of a recording for viewers: those of the original ROS 2 stack, at most 50 messages per second of each.

Replay does not need them; everything exact is in the tick messages.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from humanoid_sim.controllers.terms import USUAL_TOPICS
from humanoid_sim.messages import PolicyStep, SafetyLevel, SafetyStatus, SessionHeader, TickRecord
from humanoid_sim.mit import Extern
from humanoid_sim.recording.header import LABELS_DOCUMENT, json_document
from humanoid_sim.recording.links import Links
from humanoid_sim.ros2 import messages as ros
from humanoid_sim.ros2 import topics
from humanoid_sim.ros2.cdr import encode
from humanoid_sim.ros2.definitions import STRING
from humanoid_sim.stack import recorded_contracts

VIEWER_PERIOD = 0.02  # s between two messages of a topic that has something new in every tick


class TopicMessage(NamedTuple):
    """An encoded message, and its topic."""

    topic: str
    data: bytes
    source: str = ""  # of a safety status: the latest of each source counts; empty for other messages


def topic_prefix(header: SessionHeader) -> str:
    """Return the prefix of the robot's own topics: `topic_prefix` of its description, or else its name."""
    return json_document(header, "robot").get("topic_prefix") or header.robot


class ViewerTopics:
    """Turns the ticks of one run into messages. Keeps what was last sent on the topics that change rarely."""

    def __init__(self, header: SessionHeader, *, every_state: bool = False) -> None:
        """Prepare for a run; `every_state` is for those who control by joint states and IMU, otherwise 50 a second."""
        self.live = dict(USUAL_TOPICS)
        """Topics of live inputs, by name: the usual ones, and those of the recorded contracts."""
        for contract in recorded_contracts(header):
            self.live |= {name: topic.name for name, topic in contract.live_topics.items()}
        self._joints, labels = header.joint_names, json_document(header, LABELS_DOCUMENT)
        self._joint_topic = topics.joint_states_topic(topic_prefix(header))
        named = labels.get("observation", {})
        self._observation = tuple(
            f"{term}/{name}" for term, width in header.observation_terms for name in named.get(term) or range(width)
        )
        self._action = tuple(labels.get("action", ()))
        self._every_state = every_state
        self._every = max(1, round(VIEWER_PERIOD / header.control_period))
        self._last: dict[str, object] = {}
        """What was last sent, by topic."""
        self._inputs: dict[str, Extern] = {}
        self._safety: dict[str, SafetyStatus] = {}
        self._failed: dict[str, SafetyStatus] = {}
        self._reported: tuple[SafetyStatus, ...] = ()
        self._links = Links.of(header)
        self._transforms = ros.TransformEncoder(() if self._links is None else self._links.frames)

    def messages(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield the messages of one tick, stamped `time_ns`."""
        state, output, remote = record.input.state, record.output, record.input.remote
        is_due = record.index % self._every == 0
        if self._links is not None and self._has_changed(topics.DESCRIPTION_TOPIC, self._links.urdf):
            yield TopicMessage(topics.DESCRIPTION_TOPIC, encode(STRING, self._links.urdf))
        if is_due or self._every_state:
            measured = state.joint_position, state.joint_velocity, state.joint_effort
            yield TopicMessage(self._joint_topic, ros.encode_joint_state(time_ns, self._joints, *measured))
            yield TopicMessage(topics.IMU_TOPIC, ros.encode_imu(time_ns, state))
        if is_due:
            command = ros.encode_mit_command(time_ns, self._joints, output.command)
            yield TopicMessage(topics.SENT_TOPIC, command)
            if self._links is not None:
                frames = self._transforms.encode(time_ns, self._links.poses(record))
                yield TopicMessage(topics.TF_TOPIC, frames)
        if self._has_changed(topics.CONTROL_MODE_TOPIC, output.control_mode) or is_due:
            mode = ros.encode_control_mode(time_ns, output.control_mode)
            yield TopicMessage(topics.CONTROL_MODE_TOPIC, mode)
        standby = output.standby
        if standby is not None:
            topic = f"/{output.control_mode.controller_name}/state"
            has_changed = self._has_changed(topic, (standby.current_segment, standby.is_finished))
            if has_changed or (is_due and not standby.is_finished):
                yield TopicMessage(topic, ros.encode_standby_state(time_ns, standby))
        yield from self._safety_statuses(record, time_ns)
        if remote is not None and self._has_changed(topics.COMMAND_TOPIC, remote):
            command = ros.encode_mit_command(time_ns, self._joints, remote.command)
            yield TopicMessage(topics.COMMAND_TOPIC, command)
        if output.policy_step is not None:
            yield from self._policy_step(output.policy_step, time_ns)
        for name, live in state.extern.items():
            last = self._inputs.get(name)
            is_new = last is None or live.arrival_time != last.arrival_time
            if name in self.live and is_new and (is_due or last is None or not np.array_equal(live.value, last.value)):
                self._inputs[name] = live
                yield TopicMessage(self.live[name], ros.encode_float32_array(live.value))

    def _has_changed(self, topic: str, value: object) -> bool:
        has_changed = self._last.get(topic) != value
        self._last[topic] = value
        return has_changed

    def _safety_statuses(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield those that changed.

        A controller that failed is a source too, until it drives again; a source that reports no more is OK.
        """
        reported, recovered = record.input.safety, self._failed.pop(record.output.control_mode.controller_name, None)
        if reported == self._reported and recovered is None and not record.output.faults:
            return
        self._reported = reported
        for fault in record.output.faults:
            status = SafetyStatus(SafetyLevel.FAULT, source=fault.controller, message=fault.message)
            self._failed[fault.controller] = status
        statuses = {source: SafetyStatus(source=source) for source in self._safety}
        statuses |= {status.source: status for status in reported} | self._failed
        for source, status in statuses.items():
            if self._safety.get(source) != status:
                self._safety[source] = status
                yield TopicMessage(topics.SAFETY_TOPIC, ros.encode_safety_status(time_ns, status), source)

    def _policy_step(self, step: PolicyStep, time_ns: int) -> Iterator[TopicMessage]:
        for topic, names, values in (
            (topics.OBSERVATION_TOPIC, self._observation, step.observation),
            (topics.ACTION_TOPIC, self._action, step.action.ravel()),
        ):
            count = min(len(names), len(values))  # the answer of a policy that fails may have any length
            yield TopicMessage(topic, ros.encode_joint_state(time_ns, names[:count], values[:count]))
