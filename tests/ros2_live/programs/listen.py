"""A stranger's subscriber, with ROS 2 alone: what topics say, and how often.

    listen.py SECONDS UNTIL [TOPIC TYPE KIND]...        KIND is plain or latched

For so many seconds, and then, at most half a minute more, until the topics of UNTIL (separated by commas) were heard.

Prints JSON: the topics that are there, with their types, and of each that was asked for the number of messages, and the
last of each source.
"""

import importlib
import json
import sys
import time

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

PATIENCE = 30.0


def plain(value):
    """A message as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return int.from_bytes(value, "little")
    if hasattr(value, "tolist"):  # of array and NumPy
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def main():
    seconds = float(sys.argv[1])
    until = sys.argv[2].split(",") if sys.argv[2] else []
    wanted = [sys.argv[start : start + 3] for start in range(3, len(sys.argv), 3)]
    rclpy.init()
    node = rclpy.create_node("stranger")
    counts, last, kept = {}, {}, []
    for topic, kind, durability in wanted:
        package, _, name = kind.split("/")
        message_type = getattr(importlib.import_module(f"{package}.msg"), name)
        latched = durability == "latched"
        qos = QoSProfile(
            depth=1 if latched else 10,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        counts[topic], last[topic] = 0, {}

        def heard(message, topic=topic):
            counts[topic] += 1
            last[topic][getattr(message, "source", "")] = message

        kept.append(node.create_subscription(message_type, topic, heard, qos))
    print("ready", flush=True)
    end = time.monotonic() + seconds
    while (now := time.monotonic()) < end or (now < end + PATIENCE and not all(counts[topic] for topic in until)):
        rclpy.spin_once(node, timeout_sec=0.05)
    heard_last = {topic: {source: plain(message) for source, message in of.items()} for topic, of in last.items()}
    print(
        json.dumps(
            {
                "there": dict(node.get_topic_names_and_types()),
                "writers": {topic: node.count_publishers(topic) for topic in counts},
                "counts": counts,
                "last": heard_last,
            }
        )
    )
    rclpy.shutdown()


main()
