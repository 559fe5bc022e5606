"""A robot with a piano whose standby pose holds one key down."""

from functools import cache

import numpy as np
from result import Document

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.fingers import Fingers

__all__ = ["KEY", "press_in_standby", "pressing_pose"]

LEFT, KEY = 0, 31
"""E3, under the left hand."""


@cache
def pressing_pose() -> tuple[float, ...]:
    """Where the joints are commanded to for the left finger to hold the key down, rad; the right hand stays above."""
    fingers = Fingers(load_robot("lite_piano"))
    key = fingers.keys[KEY]
    pose = fingers.ready.copy()
    arm = fingers.arms[LEFT]
    pose[arm] = fingers.solve(LEFT, fingers.tip_above(key, 0.0, 0.9))
    stiffness = np.array(fingers.description.standby_controller_a.target_stiffness)
    pose[arm] += fingers.holding_torque(LEFT, pose[arm], 2.0) / stiffness[arm]
    return tuple(map(float, pose))


def press_in_standby(document: Document) -> None:
    """Change a robot's file: after the pose above the keys comes one with the key down."""
    standby = document["standby_controller_a"]
    standby["pose_segments"].append(list(pressing_pose()))
    standby["segment_durations"] = [0.3, 0.3, 0.3]
