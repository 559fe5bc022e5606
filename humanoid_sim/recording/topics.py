"""Topics of a recording for viewers: those of the original ROS 2 stack, at most 50 messages per second of each.

Replay does not need them; everything exact is in the tick messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import msgspec
import numpy as np

from humanoid_sim.controllers.terms import TERM_KINDS, live_kind
from humanoid_sim.messages import SafetyLevel, SafetyStatus, SessionHeader, TickRecord
from humanoid_sim.mit import Extern
from humanoid_sim.recording.header import json_document
from humanoid_sim.recording.links import Links
from humanoid_sim.ros2 import definitions as schema
from humanoid_sim.ros2 import messages as ros
from humanoid_sim.ros2 import topics
from humanoid_sim.ros2.cdr import encode

VIEWER_PERIOD = 0.02  # s between two messages of a topic that has something new in every tick
LABELS_DOCUMENT = "labels"


@dataclass(frozen=True, slots=True)
class Labels:
    """Names of the values of each observation term and of the action; without any where the header has none."""

    observation: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    action: tuple[str, ...] = ()


def labels_document(observation: Mapping[str, tuple[str, ...]], action: tuple[str, ...]) -> str:
    """Return the names as a document of a header."""
    return msgspec.json.encode(Labels(observation, action)).decode()


def read_labels(header: SessionHeader) -> Labels:
    """Return the names in a header."""
    return msgspec.json.decode(header.documents.get(LABELS_DOCUMENT, "{}"), type=Labels)


class TopicMessage(NamedTuple):
    """An encoded message, and its topic."""

    topic: str
    schema: str
    data: bytes
    source: str = ""  # of a safety status: the latest of each source counts; empty for other messages


def topic_prefix(header: SessionHeader) -> str:
    """Return the prefix of the robot's own topics: `topic_prefix` of its description, or else its name."""
    return json_document(header, "robot").get("topic_prefix") or header.robot


def _live_topics(header: SessionHeader) -> dict[str, str]:
    """Return the topics of live inputs, by name: the usual ones, and those of the recorded contract's terms."""
    found = {kind.reads: kind.topic for kind in TERM_KINDS.values() if kind.topic}
    for term in json_document(header, "contract").get("contract", {}).get("observation", ()):
        if isinstance(term, dict) and "kind" in term and (term.get("width") or term.get("topic")):
            found[term["kind"]] = term.get("topic") or live_kind(term["kind"]).topic
    return found


class ViewerTopics:
    """Turns the ticks of one run into messages. Keeps what was last sent on the topics that change rarely."""

    def __init__(self, header: SessionHeader, *, every_state: bool = False) -> None:
        """Prepare for a run; `every_state` is for those who control by joint states and IMU, otherwise 50 a second."""
        self.live = _live_topics(header)
        """Topics of live inputs, by name."""
        self._joints, labels = header.joint_names, read_labels(header)
        self._joint_topic = topics.joint_states_topic(topic_prefix(header))
        self._observation = tuple(
            f"{term}/{name}"
            for term, width in header.observation_terms
            for name in labels.observation.get(term) or range(width)
        )
        self._action = labels.action
        self._every_state = every_state
        self._every = max(1, round(VIEWER_PERIOD / header.control_period))
        self._second = max(1, round(1.0 / header.control_period))
        self._last: dict[str, object] = {}
        """What was last sent, by topic."""
        self._inputs: dict[str, Extern] = {}
        self._safety: dict[str, SafetyStatus] = {}
        self._failed: dict[str, SafetyStatus] = {}
        self._links, self._is_described = Links.of(header), False
        self._transforms = ros.TransformEncoder(() if self._links is None else self._links.frames)

    def messages(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield the messages of one tick, stamped `time_ns`."""
        state, output, remote = record.input.state, record.output, record.input.remote
        is_due = record.index % self._every == 0
        if self._links is not None and not self._is_described:
            yield from self._description(self._links, time_ns)
        if is_due or self._every_state:
            joint_state = ros.encode_joint_state(time_ns, self._joints, state)
            yield TopicMessage(self._joint_topic, schema.JOINT_STATE, joint_state)
            yield TopicMessage(topics.IMU_TOPIC, schema.IMU, ros.encode_imu(time_ns, state))
        if is_due:
            command = ros.encode_mit_command(time_ns, self._joints, output.command)
            yield TopicMessage("/mit_command", schema.MIT_COMMAND, command)
            if self._links is not None:
                yield from self._frames(self._links, record, time_ns)
        if self._has_changed(topics.CONTROL_MODE_TOPIC, output.control_mode) or is_due:
            mode = ros.encode_control_mode(time_ns, output.control_mode)
            yield TopicMessage(topics.CONTROL_MODE_TOPIC, schema.CONTROL_MODE, mode)
        standby = output.standby
        if standby is not None:
            topic = topics.standby_topic(output.control_mode.controller_name)
            has_changed = self._has_changed(topic, (standby.current_segment, standby.is_finished))
            if has_changed or (is_due and not standby.is_finished):
                yield TopicMessage(topic, schema.STANDBY_STATE, ros.encode_standby_state(time_ns, standby))
        yield from self._safety_statuses(record, time_ns)
        if remote is not None and self._has_changed(topics.COMMAND_TOPIC, remote):
            command = ros.encode_mit_command(time_ns, self._joints, remote.command)
            yield TopicMessage(topics.COMMAND_TOPIC, schema.MIT_COMMAND, command)
        if output.policy_step is not None:
            for name, names, values in (
                ("observation", self._observation, output.policy_step.observation),
                ("action", self._action, output.policy_step.action.ravel()),
            ):
                count = min(len(names), len(values))  # the answer of a policy that fails may have any length
                shown = ros.encode_named_values(time_ns, names[:count], values[:count])
                yield TopicMessage(f"/rl_policy_controller/{name}", schema.JOINT_STATE, shown)
        for name, live in state.extern.items():
            last = self._inputs.get(name)
            is_new = last is None or live.arrival_time != last.arrival_time
            if name in self.live and is_new and (is_due or last is None or not np.array_equal(live.value, last.value)):
                self._inputs[name] = live
                data = ros.encode_float32_array(live.value)
                yield TopicMessage(self.live[name], schema.FLOAT32_MULTI_ARRAY, data)

    def _has_changed(self, topic: str, value: object) -> bool:
        has_changed = self._last.get(topic) != value
        self._last[topic] = value
        return has_changed

    def _safety_statuses(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield those that changed, and all once a second for volatile subscribers that come late.

        A controller that failed is a source too, until it drives again; a source that reports no more is OK.
        """
        self._failed.pop(record.output.control_mode.controller_name, None)
        for fault in record.output.faults:
            status = SafetyStatus(SafetyLevel.FAULT, source=fault.controller, message=fault.message)
            self._failed[fault.controller] = status
        statuses = {source: SafetyStatus(source=source) for source in self._safety}
        statuses |= {status.source: status for status in record.input.safety} | self._failed
        is_due = record.index % self._second == 0
        for source, status in statuses.items():
            if is_due or self._safety.get(source) != status:
                self._safety[source] = status
                data = ros.encode_safety_status(time_ns, status)
                yield TopicMessage(topics.SAFETY_TOPIC, schema.SAFETY_STATUS, data, source)

    def _description(self, links: Links, time_ns: int) -> Iterator[TopicMessage]:
        """Yield the URDF, and the links that do not move."""
        self._is_described = True
        yield TopicMessage(topics.DESCRIPTION_TOPIC, schema.STRING, encode(schema.STRING, links.urdf))
        if links.fixed_frames:
            data = ros.TransformEncoder(links.fixed_frames).encode(time_ns, links.fixed_poses)
            yield TopicMessage(topics.TF_STATIC_TOPIC, schema.TF_MESSAGE, data)

    def _frames(self, links: Links, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield where the links are, each in its parent's frame, and the base in the world's."""
        poses = links.poses(record)
        if len(poses):
            yield TopicMessage(topics.TF_TOPIC, schema.TF_MESSAGE, self._transforms.encode(time_ns, poses))
        if links.base is not None and links.knows_base(record):
            base = ros.encode_pose(time_ns, "world", poses[links.base])
            yield TopicMessage("/base_pose", schema.POSE_STAMPED, base)
