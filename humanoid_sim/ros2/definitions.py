"""The message definitions, as `ros2msg` text: what ROS 2 tools need to decode a topic or a recording.

`definitions.msg` holds all of them. `humanoid_control_msgs` is wire-compatible with the ROS 2 stack and frozen.
`humanoid_sim_msgs` is this project's own.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

SCHEMA_ENCODING = "ros2msg"

FLOAT32_MULTI_ARRAY = "std_msgs/msg/Float32MultiArray"
JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
STRING = "std_msgs/msg/String"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
MIT_COMMAND = "humanoid_control_msgs/msg/MITCommand"
CONTROL_MODE = "humanoid_control_msgs/msg/ControlMode"
STANDBY_STATE = "humanoid_control_msgs/msg/StandbyState"
SAFETY_STATUS = "humanoid_control_msgs/msg/SafetyStatus"
EVENT = "humanoid_sim_msgs/msg/Event"
TICK = "humanoid_sim_msgs/msg/Tick"

_TEXT = Path(__file__).with_name("definitions.msg").read_text(encoding="utf-8")
_DEFINITIONS = dict(re.findall(r"^MSG: (\S+)\n(.*?)(?=^MSG: |\Z)", _TEXT, re.MULTILINE | re.DOTALL))
_FIELD = re.compile(r"^([A-Za-z0-9_/]+)(\[\d*\])? +([a-z][a-z0-9_]*) *(?:#.*)?$", re.MULTILINE)


class MessageField(NamedTuple):
    """A field of a message definition."""

    name: str
    kind: str  # a primitive, such as `float64`, or a message type, such as `std_msgs/msg/Header`
    length: int | None  # None: a single value; 0: a sequence; else an array of that length


def message_fields(name: str) -> tuple[MessageField, ...]:
    """Return the fields of a message type (`package/msg/Type`) in their order; constants are none."""
    return tuple(
        MessageField(field, kind.replace("/", "/msg/"), int(brackets[1:-1] or 0) if brackets else None)
        for kind, brackets, field in _FIELD.findall(_DEFINITIONS[name.replace("/msg/", "/")])
    )


def schema_text(name: str) -> str:
    """Return the definition of a message type (`package/msg/Type`), followed by those it depends on: MCAP's form."""
    first = name.replace("/msg/", "/")
    pending, texts = [first], [_DEFINITIONS[first]]
    for key in pending:
        for kind, _, _ in _FIELD.findall(_DEFINITIONS[key]):
            if kind in _DEFINITIONS and kind not in pending:
                pending.append(kind)
                texts.append(f"{'=' * 80}\nMSG: {kind}\n{_DEFINITIONS[kind]}")
    return "".join(texts)
