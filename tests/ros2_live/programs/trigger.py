"""A stranger's client, with ROS 2 alone: call services named on the command line, or see which there are."""

import json
import sys
import time

import rclpy
from std_srvs.srv import Trigger

PREFIX = "/humanoid_control/mode/"


def call(node, word):
    """[success, message] of a service; None if it is not there."""
    client = node.create_client(Trigger, PREFIX + word)
    if not client.wait_for_service(timeout_sec=10.0):
        return None
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    response = future.result()
    return response and [response.success, response.message]


def main():
    rclpy.init()
    node = rclpy.create_node("stranger")
    if sys.argv[1] == "list":
        wanted, end = int(sys.argv[2]), time.monotonic() + float(sys.argv[3])
        found = []
        while len(found) < wanted and time.monotonic() < end:
            time.sleep(0.1)
            found = sorted(
                [name, types] for name, types in node.get_service_names_and_types() if name.startswith(PREFIX)
            )
        print(json.dumps(found))
    elif sys.argv[1] == "serve":  # as a node with default settings would
        node.create_service(Trigger, PREFIX + "damp", lambda _, response: response)
        print("ready", flush=True)
        rclpy.spin(node)
    else:
        print("ready", flush=True)
        for line in sys.stdin:
            print(json.dumps(call(node, line.strip())), flush=True)
    rclpy.shutdown()


main()
