"""A stranger's monitor, with ROS 2 alone: each line that comes in, `LEVEL MESSAGE`, becomes a `/safety_status`."""

import sys

import rclpy
from humanoid_control_msgs.msg import SafetyStatus


def main():
    rclpy.init()
    node = rclpy.create_node("fence")
    publisher = node.create_publisher(SafetyStatus, "/safety_status", 10)
    print("ready", flush=True)
    for line in sys.stdin:
        level, _, message = line.strip().partition(" ")
        status = SafetyStatus(level=int(level), source="fence", message=message)
        status.header.stamp = node.get_clock().now().to_msg()
        while not publisher.get_subscription_count():
            rclpy.spin_once(node, timeout_sec=0.05)
        publisher.publish(status)
        print("published", flush=True)
    rclpy.shutdown()


main()
