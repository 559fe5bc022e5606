"""The topics that a session serves and records: names, types and quality of service, those of the ROS 2 stack."""

from __future__ import annotations

import re
from typing import NamedTuple

from humanoid_sim.ros2.definitions import (
    CONTROL_MODE,
    EVENT,
    FLOAT32_MULTI_ARRAY,
    IMU,
    JOINT_STATE,
    MIT_COMMAND,
    SAFETY_STATUS,
    STANDBY_STATE,
    STRING,
    TF_MESSAGE,
    TICK,
)


class Topic(NamedTuple):
    """Type and quality of service of a topic. All are reliable."""

    schema: str  # message type, such as `sensor_msgs/msg/Imu`
    depth: int = 10  # messages that are kept (KEEP_LAST)
    latched: bool = False  # durability transient local: a late subscriber gets the last one


IMU_TOPIC = "/imu/data"
CONTROL_MODE_TOPIC = "/control_mode"
SAFETY_TOPIC = "/safety_status"
DESCRIPTION_TOPIC = "/robot_description"
TF_TOPIC = "/tf"
COMMAND_TOPIC = "/remote_policy_controller/command"
STANDBY_TOPICS = ("/standby_controller_a/state", "/standby_controller_b/state")
TOPICS = {
    IMU_TOPIC: Topic(IMU),
    CONTROL_MODE_TOPIC: Topic(CONTROL_MODE),
    SAFETY_TOPIC: Topic(SAFETY_STATUS, 1, True),
    DESCRIPTION_TOPIC: Topic(STRING, 1, True),
    TF_TOPIC: Topic(TF_MESSAGE, 100),
    COMMAND_TOPIC: Topic(MIT_COMMAND, 4),
    **dict.fromkeys(STANDBY_TOPICS, Topic(STANDBY_STATE, 1, True)),
}
"""Those on DDS, by name. Joint states are under a robot's prefix."""
TICK_TOPIC, EVENT_TOPIC = "/humanoid_sim/tick", "/humanoid_sim/event"
SENT_TOPIC = "/mit_command"  # what left for the robot
OBSERVATION_TOPIC, ACTION_TOPIC = "/rl_policy_controller/observation", "/rl_policy_controller/action"
_RECORDED = {
    TICK_TOPIC: Topic(TICK),
    EVENT_TOPIC: Topic(EVENT),
    SENT_TOPIC: Topic(MIT_COMMAND),
    **dict.fromkeys((OBSERVATION_TOPIC, ACTION_TOPIC), Topic(JOINT_STATE)),
}
LIVE_INPUT = Topic(FLOAT32_MULTI_ARRAY, 1)  # of a live input, whose name a policy's contract has
_JOINT_STATES = "/joint_states"


def joint_states_topic(prefix: str) -> str:
    """Return the topic of the joint states of robots with that prefix; what ROS 2 allows in no name becomes `_`."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", prefix)
    return f"/{'_' if name[:1].isdigit() else ''}{name}{_JOINT_STATES}"


def topic_kind(topic: str) -> Topic:
    """Return type and quality of service of a topic; one that a session has no other use for is a live input's."""
    if topic.endswith(_JOINT_STATES):
        return Topic(JOINT_STATE)
    return TOPICS.get(topic) or _RECORDED.get(topic) or LIVE_INPUT
