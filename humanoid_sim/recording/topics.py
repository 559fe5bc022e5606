"""What a recording shows to viewers: the ROS 2 topics of the original stack, at most 50 per second of each.

Replay does not need them; everything exact is in the tick messages.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from humanoid_sim.messages import (
    ControlMode,
    PolicyStep,
    RemoteCommand,
    SafetyStatus,
    SessionHeader,
    StandbyState,
    TickRecord,
)
from humanoid_sim.mit import MITState
from humanoid_sim.ros2.definitions import (
    CONTROL_MODE,
    FLOAT32_MULTI_ARRAY,
    IMU,
    JOINT_STATE,
    MIT_COMMAND,
    SAFETY_STATUS,
    STANDBY_STATE,
)
from humanoid_sim.ros2.messages import (
    encode_control_mode,
    encode_float32_array,
    encode_imu,
    encode_joint_state,
    encode_mit_command,
    encode_safety_status,
    encode_standby_state,
)

__all__ = ["LATCHED", "TopicMessage", "ViewerTopics"]

VIEWER_PERIOD = 0.02
"""s between two messages of a topic that has something new in every tick."""

LATCHED = frozenset((STANDBY_STATE, SAFETY_STATUS))
"""Types that are published with transient-local durability: a late subscriber gets the last one."""

_KEY_PRESSED = "key_pressed"


class TopicMessage(NamedTuple):
    """An encoded message, and where it belongs."""

    topic: str
    schema: str
    data: bytes


class ViewerTopics:
    """Turns the ticks of one run into messages. Keeps what it last said, for the topics that change rarely."""

    def __init__(self, header: SessionHeader) -> None:
        """Prepare for the run that `header` describes."""
        self._joints = header.joint_names
        self._joint_topic = f"/{header.robot}/joint_states"
        self._terms = header.observation_terms
        self._every = max(1, round(VIEWER_PERIOD / header.control_period))
        self._control_mode: ControlMode | None = None
        self._standby: tuple[str, StandbyState | None] = ("", None)
        self._safety: dict[str, SafetyStatus] = {}
        self._remote: RemoteCommand | None = None
        self._keys_arrival: float | None = None

    def messages(self, record: TickRecord, time_ns: int) -> Iterator[TopicMessage]:
        """The messages of one tick, stamped `time_ns`."""
        state, output = record.input.state, record.output
        is_due = record.index % self._every == 0
        if is_due:
            yield TopicMessage(self._joint_topic, JOINT_STATE, encode_joint_state(time_ns, self._joints, state))
            yield TopicMessage("/imu/data", IMU, encode_imu(time_ns, state))
            yield TopicMessage("/mit_command", MIT_COMMAND, encode_mit_command(time_ns, self._joints, output.command))
        if is_due or output.control_mode != self._control_mode:
            self._control_mode = output.control_mode
            yield TopicMessage("/control_mode", CONTROL_MODE, encode_control_mode(time_ns, output.control_mode))
        if output.standby is not None:
            yield from self._standby_state(output.control_mode.controller_name, output.standby, time_ns, is_due)
        for status in record.input.safety:
            if self._safety.get(status.source) != status:
                self._safety[status.source] = status
                yield TopicMessage("/safety_status", SAFETY_STATUS, encode_safety_status(time_ns, status))
        remote = record.input.remote
        if remote is not None and remote is not self._remote:
            self._remote = remote
            data = encode_mit_command(time_ns, self._joints, remote.command)
            yield TopicMessage("/remote_policy_controller/command", MIT_COMMAND, data)
        if output.policy_step is not None:
            yield from self._policy_step(output.policy_step)
        if state.extern:
            yield from self._key_state(state)

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
            yield TopicMessage(f"/{controller}/state", STANDBY_STATE, encode_standby_state(time_ns, standby))

    def _policy_step(self, step: PolicyStep) -> Iterator[TopicMessage]:
        """The observation term by term, and the raw action."""
        start = 0
        for name, width in self._terms:
            data = encode_float32_array(step.observation[start : start + width])
            start += width
            yield TopicMessage(f"/rl_policy_controller/observation/{name}", FLOAT32_MULTI_ARRAY, data)
        yield TopicMessage("/rl_policy_controller/action", FLOAT32_MULTI_ARRAY, encode_float32_array(step.action))

    def _key_state(self, state: MITState) -> Iterator[TopicMessage]:
        keys = state.extern.get(_KEY_PRESSED)
        if keys is not None and keys.arrival_time != self._keys_arrival:
            self._keys_arrival = keys.arrival_time
            yield TopicMessage(
                "/piano/key_state", FLOAT32_MULTI_ARRAY, encode_float32_array(keys.value.astype(np.float32))
            )
