"""A stranger's subscriber, with ROS 2 alone: listen.py SECONDS UNTIL TOPICS

For so many seconds, and then, at most half a minute more, until the topics of UNTIL, a JSON list, were heard. TOPICS is
a JSON object: by topic, its type, and whether it is latched. Prints JSON: the topics that are there, with their types,
and of each that was asked for its writers, the number of messages, and the last of each source.
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
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def main():
    seconds, until, wanted = map(json.loads, sys.argv[1:])
    rclpy.init()
    node = rclpy.create_node("stranger")
    counts, last, kept = dict.fromkeys(wanted, 0), {topic: {} for topic in wanted}, []
    for topic, (kind, latched) in wanted.items():
        package, _, name = kind.split("/")
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=durability)

        def heard(message, topic=topic):
            counts[topic] += 1
            last[topic][getattr(message, "source", "")] = plain(message)

        message_type = getattr(importlib.import_module(f"{package}.msg"), name)
        kept.append(node.create_subscription(message_type, topic, heard, qos))
    print("ready", flush=True)
    end = time.monotonic() + seconds
    while (now := time.monotonic()) < end or (now < end + PATIENCE and not all(counts[topic] for topic in until)):
        rclpy.spin_once(node, timeout_sec=0.05)
    there = dict(node.get_topic_names_and_types())
    writers = {topic: node.count_publishers(topic) for topic in wanted}
    print(json.dumps({"there": there, "writers": writers, "counts": counts, "last": last}))
    rclpy.shutdown()


main()
