"""The topics of the ROS 2 stack that this package serves: names, types and quality of service.

One table for recordings, the DDS bridge and its clients.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from humanoid_sim.ros2.definitions import (
    CLOCK,
    CONTROL_MODE,
    FLOAT32_MULTI_ARRAY,
    IMU,
    MIT_COMMAND,
    SAFETY_STATUS,
    STANDBY_STATE,
    STRING,
    TF_MESSAGE,
)


class Topic(NamedTuple):
    """Type and quality of service of a topic. All are reliable."""

    schema: str
    """The message type, such as `sensor_msgs/msg/Imu`."""
    depth: int = 10
    """Messages that are kept (KEEP_LAST)."""
    latched: bool = False
    """Durability transient local: a late subscriber gets the last one."""


IMU_TOPIC = "/imu/data"
CONTROL_MODE_TOPIC = "/control_mode"
SAFETY_TOPIC = "/safety_status"
DESCRIPTION_TOPIC = "/robot_description"
TF_TOPIC, TF_STATIC_TOPIC = "/tf", "/tf_static"
CLOCK_TOPIC = "/clock"
COMMAND_TOPIC = "/remote_policy_controller/command"
STANDBY_TOPIC = "/standby_controller/state"
"""Topic of the time when there was one pose; carries the state of either."""
STANDBY_TOPICS = ("/standby_controller_a/state", "/standby_controller_b/state")

_LATCHED_STATE = Topic(STANDBY_STATE, 1, True)
TOPICS: Mapping[str, Topic] = MappingProxyType(
    {
        IMU_TOPIC: Topic(IMU),
        CONTROL_MODE_TOPIC: Topic(CONTROL_MODE),
        SAFETY_TOPIC: Topic(SAFETY_STATUS, 1, True),
        DESCRIPTION_TOPIC: Topic(STRING, 1, True),
        TF_TOPIC: Topic(TF_MESSAGE, 100),
        TF_STATIC_TOPIC: Topic(TF_MESSAGE, 1, True),
        CLOCK_TOPIC: Topic(CLOCK),
        COMMAND_TOPIC: Topic(MIT_COMMAND, 4),
        STANDBY_TOPIC: _LATCHED_STATE,
        **dict.fromkeys(STANDBY_TOPICS, _LATCHED_STATE),
    }
)
"""By name. Joint states are under a robot's prefix; see `kind_of`."""

LIVE_INPUT = Topic(FLOAT32_MULTI_ARRAY, 1)
"""Topic of a live input, which a policy's contract names."""
_JOINT_STATES = "/joint_states"
_NO_NAME = re.compile(r"[^A-Za-z0-9_]")


def joint_states_topic(prefix: str) -> str:
    """Return the topic of the joint states of robots with that prefix; what ROS 2 allows in no name becomes `_`."""
    name = _NO_NAME.sub("_", prefix)
    return f"/{'_' if name[:1].isdigit() else ''}{name}{_JOINT_STATES}"


def is_used(topic: str) -> bool:
    """Return whether a session has another use for a topic: no live input may come on it."""
    return topic in TOPICS or topic.endswith(_JOINT_STATES) or topic in ("/mit_command", "/base_pose")


def standby_topic(controller: str) -> str:
    """Return the topic of a standby controller's state."""
    return f"/{controller}/state"


def kind_of(topic: str, schema: str) -> Topic:
    """Return what a topic is; one that the stack does not know, such as an observation's, is kept as most are."""
    return TOPICS.get(topic, Topic(schema))
