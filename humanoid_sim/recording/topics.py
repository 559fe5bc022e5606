"""Topics of a recording for viewers: those of the original ROS 2 stack, at most 50 messages per second of each.

Replay does not need them; everything exact is in the tick messages.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.terms import TERM_KINDS, live_kind
from humanoid_sim.messages import (
    ControlMode,
    PolicyStep,
    RemoteCommand,
    SafetyLevel,
    SafetyStatus,
    SessionHeader,
    StandbyState,
    TickRecord,
)
from humanoid_sim.mit import Extern, MITState
from humanoid_sim.recording.body import RecordedBody, json_document
from humanoid_sim.ros2 import definitions as schema
from humanoid_sim.ros2 import messages as ros
from humanoid_sim.ros2 import topics

VIEWER_PERIOD = 0.02
"""s between two messages of a topic that has something new in every tick."""


LABELS_DOCUMENT = "labels"


@dataclass(frozen=True, slots=True)
class Labels:
    """Names of the values of each observation term and of the action; without any where the header has none."""

    observation: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    action: tuple[str, ...] = ()


def labels_document(observation: Mapping[str, tuple[str, ...]], action: tuple[str, ...]) -> str:
    """Return the names as a document of a header."""
    return json.dumps({"observation": observation, "action": action})


def read_labels(header: SessionHeader) -> Labels:
    """Return the names in a header; names that are damaged or missing are none: plots go without."""
    try:
        document = json_document(header.documents, LABELS_DOCUMENT)
        observation = {str(term): _texts(names) for term, names in document.get("observation", {}).items()}
        return Labels(observation, _texts(document.get("action", [])))
    except (ValueError, TypeError, AttributeError):
        return Labels()


def _texts(values: object) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise TypeError
    return tuple(str(value) for value in values)


class TopicMessage(NamedTuple):
    """An encoded message, and its topic."""

    topic: str
    schema: str
    data: bytes
    source: str = ""
    """Source of a safety status: the latest of each source counts; empty for other messages."""


def topic_prefix(header: SessionHeader) -> str:
    """Return what the robot's own topics are under: `topic_prefix` of its description, or else its name."""
    prefix = json_document(header.documents, "robot").get("topic_prefix")
    return prefix if isinstance(prefix, str) and prefix else header.robot


def _live_topics(header: SessionHeader) -> Mapping[str, str]:
    """Return the topics of live inputs, by name: the usual ones, and those of the recorded contract's terms."""
    found = {kind.reads: kind.topic for kind in TERM_KINDS.values() if kind.topic}
    for term in json_document(header.documents, "contract").get("contract", {}).get("observation", ()):
        if isinstance(term, dict) and "kind" in term and ("width" in term or "topic" in term):
            found[term["kind"]] = term.get("topic") or live_kind(term["kind"]).topic
    return found


class PolicyTopics:
    """Turns the steps of one policy into messages: arrays, or under the names of their values where there are any."""

    def __init__(self, header: SessionHeader) -> None:
        """Prepare for the terms of a run's observation."""
        labels = read_labels(header)
        self._terms = tuple(
            (f"/rl_policy_controller/observation/{name}", width, labels.observation.get(name))
            for name, width in header.observation_terms
        )
        self._action = "/rl_policy_controller/action", labels.action

    def messages(self, step: PolicyStep, time_ns: int) -> Iterator[TopicMessage]:
        """Yield the observation term by term, and the raw action."""
        start = 0
        for topic, width, names in self._terms:
            values = step.observation[start : start + width]
            start += width
            yield self._values(topic, names, values, time_ns)
        topic, names = self._action
        yield self._values(topic, names, step.action, time_ns)

    @staticmethod
    def _values(
        topic: str, names: tuple[str, ...] | None, values: npt.NDArray[np.float32], time_ns: int
    ) -> TopicMessage:
        """Under their names, if there are any; of a policy that fails, the answer may have any shape."""
        if not names:
            return TopicMessage(topic, schema.FLOAT32_MULTI_ARRAY, ros.encode_float32_array(values))
        flat = values.reshape(-1)[: len(names)]
        return TopicMessage(topic, schema.JOINT_STATE, ros.encode_named_values(time_ns, names[: len(flat)], flat))


class ViewerTopics:
    """Turns the ticks of one run into messages. Keeps what it last said, for the topics that change rarely."""

    def __init__(self, header: SessionHeader, *, every_state: bool = False) -> None:
        """Prepare for a run; `every_state` is for those who control by joint states and IMU, otherwise 50 a second."""
        self._joints = header.joint_names
        self._joint_topic = topics.joint_states_topic(topic_prefix(header))
        self._every_state = every_state
        self._every = max(1, round(VIEWER_PERIOD / header.control_period))
        self._control_mode: ControlMode | None = None
        self._standby: tuple[str, StandbyState | None] = ("", None)
        self._safety: dict[str, SafetyStatus] = {}
        self._failed: dict[str, SafetyStatus] = {}
        self._second = max(1, round(1.0 / header.control_period))
        self._remote: RemoteCommand | None = None
        self._heard: dict[str, Extern] = {}
        self.live = _live_topics(header)
        """Topics of live inputs, by name."""
        self._policy = PolicyTopics(header)
        self._body = RecordedBody.of(header)
        self._is_described = self._body is None
        if self._body is not None:
            moving = (*self._body.hinged, *self._body.floating)
            self._transforms = ros.TransformEncoder([(joint.parent, joint.child) for joint in moving])
            self._poses = np.empty((len(moving), 7))

    def messages(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield the messages of one tick, stamped `time_ns`."""
        state, output = record.input.state, record.output
        is_due = record.index % self._every == 0
        if not self._is_described:
            self._is_described = True
            yield from self._description(time_ns)
        if is_due or self._every_state:
            data = ros.encode_joint_state(time_ns, self._joints, state)
            yield TopicMessage(self._joint_topic, schema.JOINT_STATE, data)
            yield TopicMessage(topics.IMU_TOPIC, schema.IMU, ros.encode_imu(time_ns, state))
        if is_due:
            data = ros.encode_mit_command(time_ns, self._joints, output.command)
            yield TopicMessage("/mit_command", schema.MIT_COMMAND, data)
        if is_due or output.control_mode != self._control_mode:
            self._control_mode = output.control_mode
            data = ros.encode_control_mode(time_ns, output.control_mode)
            yield TopicMessage(topics.CONTROL_MODE_TOPIC, schema.CONTROL_MODE, data)
        if output.standby is not None:
            yield from self._standby_state(output.control_mode.controller_name, output.standby, time_ns, is_due)
        yield from self._safety_statuses(record, time_ns)
        remote = record.input.remote
        if remote is not None and remote is not self._remote:
            self._remote = remote
            data = ros.encode_mit_command(time_ns, self._joints, remote.command)
            yield TopicMessage(topics.COMMAND_TOPIC, schema.MIT_COMMAND, data)
        if is_due and self._body is not None:
            yield from self._frames(self._body, record, time_ns)
        if output.policy_step is not None:
            yield from self._policy.messages(output.policy_step, time_ns)
        if state.extern:
            yield from self._live_inputs(state, is_due)

    def _standby_state(
        self, controller: str, standby: StandbyState, time_ns: int, is_due: bool
    ) -> Iterator[TopicMessage]:
        """On change; at once when the controller, the segment or `is_finished` changes."""
        key = (controller, standby)
        last = self._standby[1]
        is_news = (
            self._standby[0] != controller
            or last is None
            or (last.is_finished, last.current_segment) != (standby.is_finished, standby.current_segment)
        )
        if is_news or (is_due and key != self._standby):
            self._standby = key
            data = ros.encode_standby_state(time_ns, standby)
            yield TopicMessage(topics.standby_topic(controller), schema.STANDBY_STATE, data)

    def _safety_statuses(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield those that changed, and all once a second: a volatile subscriber that comes late sees them too.

        A controller that failed is a source as well, until it drives again. A source that does not report any more is
        well: its last word would stand otherwise.
        """
        driving = record.output.control_mode.controller_name
        self._failed.pop(driving, None)
        for fault in record.output.faults:
            self._failed[fault.controller] = SafetyStatus(
                SafetyLevel.FAULT, source=fault.controller, message=fault.message
            )
        heard = {**{status.source: status for status in record.input.safety}, **self._failed}
        gone = {source: SafetyStatus(source=source) for source in self._safety if source not in heard}
        is_due = record.index % self._second == 0
        for source, status in (heard | gone).items():
            if is_due or self._safety.get(source) != status:
                self._safety[source] = status
                data = ros.encode_safety_status(time_ns, status)
                yield TopicMessage(topics.SAFETY_TOPIC, schema.SAFETY_STATUS, data, source)

    def _description(self, time_ns: int) -> Iterator[TopicMessage]:
        """Yield what the robot looks like, and the links that do not move."""
        assert self._body is not None  # asked by the caller
        yield TopicMessage(topics.DESCRIPTION_TOPIC, schema.STRING, ros.encode_string(self._body.urdf))
        fixed = self._body.fixed
        if fixed:
            encoder = ros.TransformEncoder([(joint.parent, joint.child) for joint in fixed])
            poses = np.array([[*joint.position, *joint.quaternion] for joint in fixed])
            yield TopicMessage(topics.TF_STATIC_TOPIC, schema.TF_MESSAGE, encoder.encode(time_ns, poses))

    def _frames(self, body: RecordedBody, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """Yield where the links are, each in its parent's frame, and the base in the world's."""
        count = len(body.hinged)
        self._poses[:count, :3], self._poses[:count, 3:] = body.hinged_poses(body.joint_values(record))
        if body.floating:
            self._poses[count:] = body.floating_poses(record)
        if len(self._poses):
            yield TopicMessage(topics.TF_TOPIC, schema.TF_MESSAGE, self._transforms.encode(time_ns, self._poses))
        if body.floating and body.knows_base(record):
            yield TopicMessage("/base_pose", schema.POSE_STAMPED, ros.encode_pose(time_ns, "world", self._poses[count]))

    def _live_inputs(self, state: MITState, is_due: bool) -> Iterator[TopicMessage]:
        """On change at once; else at most 50 a second, as long as new ones arrive."""
        for name, topic in self.live.items():
            heard, last = state.extern.get(name), self._heard.get(name)
            if heard is None:
                continue
            is_news = last is None or not np.array_equal(heard.value, last.value)
            is_new = last is None or heard.arrival_time != last.arrival_time
            if is_news or (is_due and is_new):
                self._heard[name] = heard
                data = ros.encode_float32_array(heard.value.astype(np.float32))
                yield TopicMessage(topic, schema.FLOAT32_MULTI_ARRAY, data)
