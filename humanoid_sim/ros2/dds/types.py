"""Message definitions as Cyclone DDS wants them, and ROS 2's names on DDS.

The library needs a type to announce a topic by; samples themselves are bytes, which `humanoid_sim.ros2.messages` makes.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from humanoid_sim.ros2.definitions import message_fields

__all__ = ["dds_topic", "dds_type", "idl_type"]

_PREFIX = "rt"
"""Of topics, as opposed to services."""


def dds_topic(topic: str) -> str:
    """The DDS name of a ROS 2 topic: `rt/control_mode` for `/control_mode`."""
    return f"{_PREFIX}{topic}"


def dds_type(schema: str) -> str:
    """The DDS name of a message type: `std_msgs::msg::dds_::Header_` for `std_msgs/msg/Header`."""
    package, kind, name = schema.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@cache
def idl_type(schema: str) -> Any:
    """A message type as Cyclone DDS's `IdlStruct`."""
    from cyclonedds.idl import make_idl_struct, types  # noqa: PLC0415 - an extra

    primitives = {
        "bool": bool,
        "string": str,
        "uint8": types.uint8,
        "int32": types.int32,
        "uint32": types.uint32,
        "int64": types.int64,
        "uint64": types.uint64,
        "float32": types.float32,
        "float64": types.float64,
    }
    fields = {}
    for field in message_fields(schema):
        kind = primitives[field.kind] if field.kind in primitives else idl_type(field.kind)
        if field.length is not None:
            kind = types.array[kind, field.length] if field.length else types.sequence[kind]
        fields[field.name] = kind
    return make_idl_struct(f"{schema.rpartition('/')[2]}_", dds_type(schema), fields)
