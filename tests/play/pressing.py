"""A robot with a piano whose standby pose holds one key down."""

from play_fixtures import Document

from humanoid_sim.robots.description import load_robot

__all__ = ["KEY", "press_in_standby", "pressing_pose"]

KEY = 31
"""E3, under the left hand."""
_PRESSING = (-0.4236, 0.0607, -1.1207, -1.9237, -0.0556, 0.1906, -0.3272)
"""rad, commands of the left arm at a stiffness of 50 N·m/rad that hold the key down with 2 N."""


def pressing_pose() -> tuple[float, ...]:
    """Where the joints are commanded to for the left finger to hold the key down, rad; the right hand stays above."""
    return _PRESSING + load_robot("lite_piano").standby_controller_a.pose_segments[-1][7:]


def press_in_standby(document: Document) -> None:
    """Change a robot's file: after the pose above the keys comes one with the key down."""
    standby = document["standby_controller_a"]
    standby["pose_segments"].append(list(pressing_pose()))
    standby["segment_durations"] = [0.3, 0.3, 0.3]
