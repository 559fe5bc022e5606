"""A stranger's commands for REMOTE, with ROS 2 alone: `command.py POSITION JOINT…`, 100 a second, until it is ended.

Every joint is sent to a position in rad, with K_p 30 and K_d 2.
"""

import sys

import rclpy
from humanoid_control_msgs.msg import MITCommand
from rclpy.qos import QoSProfile, ReliabilityPolicy

PERIOD = 0.01
NAMES = sys.argv[2:]


def main():
    position = float(sys.argv[1])
    rclpy.init()
    node = rclpy.create_node("commander")
    publisher = node.create_publisher(
        MITCommand, "/remote_policy_controller/command", QoSProfile(depth=4, reliability=ReliabilityPolicy.RELIABLE)
    )
    count = len(NAMES)

    def send():
        command = MITCommand(joint_names=NAMES)
        command.header.stamp = node.get_clock().now().to_msg()
        command.position, command.velocity = [position] * count, [0.0] * count
        command.effort, command.stiffness, command.damping = [0.0] * count, [30.0] * count, [2.0] * count
        publisher.publish(command)

    node.create_timer(PERIOD, send)
    print("ready", flush=True)
    rclpy.spin(node)


main()
