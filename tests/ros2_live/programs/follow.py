"""A stranger's goals, with ROS 2 alone: FollowJointTrajectory, one line of JSON each; a line `cancel` cancels the last.

[[[SECONDS, {JOINT: RAD}]...], {JOINT: RAD of its path tolerance}, {JOINT: RAD of its goal tolerance}, SECONDS]

Prints JSON when a goal has ended: its status, error code, text, and how much feedback there was.
"""

import json
import sys
import threading
import time

import rclpy
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import JointTolerance
from rclpy.action import ActionClient
from trajectory_msgs.msg import JointTrajectoryPoint


def duration(seconds):
    return Duration(sec=int(seconds), nanosec=int(1e9 * (seconds % 1.0)))


def goal_of(points, path, goal, goal_time):
    wanted = FollowJointTrajectory.Goal()
    wanted.trajectory.joint_names = list(points[0][1])
    wanted.trajectory.points = [
        JointTrajectoryPoint(positions=list(where.values()), time_from_start=duration(seconds))
        for seconds, where in points
    ]
    wanted.path_tolerance, wanted.goal_tolerance = (
        [JointTolerance(name=name, position=value) for name, value in given.items()] for given in (path, goal)
    )
    wanted.goal_time_tolerance = duration(goal_time)
    return wanted


def main():
    rclpy.init()
    node = rclpy.create_node("planner")
    client = ActionClient(node, FollowJointTrajectory, "/remote_policy_controller/follow_joint_trajectory")
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    assert client.wait_for_server(timeout_sec=10.0)
    print("ready", flush=True)
    handle = None
    for line in sys.stdin:
        if line.strip() == "cancel":
            handle.cancel_goal_async()
            continue
        feedback = []
        sent = client.send_goal_async(goal_of(*json.loads(line)), feedback_callback=feedback.append)
        while not sent.done():
            time.sleep(0.01)
        handle = sent.result()
        handle.get_result_async().add_done_callback(lambda done, feedback=feedback: tell(done.result(), feedback))


def tell(told, feedback):
    result = told.result
    print(json.dumps([told.status, result.error_code, result.error_string, len(feedback)]), flush=True)


main()
