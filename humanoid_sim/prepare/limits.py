"""What a motion without body poses can still be checked against: the joints' limits, and which way is up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.controllers.terms import QuaternionOrder
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.source import SourceMotion, swap_quaternion_order
from humanoid_sim.robots.description import RobotDescription

__all__ = ["LimitExcess", "is_upside_down", "orders_within_limits", "worst_excess"]


@dataclass(frozen=True, slots=True)
class LimitExcess:
    """A joint of the motion that is beyond its limits."""

    joint: str
    frame: int
    position: float
    """rad"""
    lower: float
    """rad"""
    upper: float
    """rad"""

    @property
    def excess(self) -> float:
        """Rad beyond the limit."""
        return max(self.lower - self.position, self.position - self.upper)


def worst_excess(joint_position: FloatArray, description: RobotDescription) -> LimitExcess | None:
    """The joint and frame farthest beyond the limits; None if all (F, n), rad, robot's order, are within."""
    beyond = np.maximum(description.lower - joint_position, joint_position - description.upper)
    if beyond.max() <= 0.0:
        return None
    frame, joint = (int(i) for i in np.unravel_index(int(beyond.argmax()), beyond.shape))
    described = description.joints[joint]
    position = float(joint_position[frame, joint])
    return LimitExcess(described.name, frame, position, described.lower, described.upper)


def orders_within_limits(
    columns: FloatArray, orders: Mapping[str, tuple[str, ...]], description: RobotDescription, margin: float
) -> list[str]:
    """Names of the orders in which columns (F, n), rad, stay within the joints' limits and a margin, rad."""
    found = []
    for name, order in orders.items():
        if len(order) == columns.shape[1] and set(order) == set(description.joint_names):
            position = columns[:, [order.index(joint) for joint in description.joint_names]]
            worst = worst_excess(position, description)
            if worst is None or worst.excess <= margin:
                found.append(name)
    return found


def is_upside_down(source: SourceMotion) -> bool:
    """The base is upside down most of the time, and would be upright with quaternions in the other order."""
    if source.base_quaternion is None:
        return False
    other: QuaternionOrder = "xyzw" if source.quaternion_order == "wxyz" else "wxyz"
    up, otherwise = (
        float(matrix(swap_quaternion_order(source.base_quaternion, order))[:, 2, 2].mean())
        for order in (source.quaternion_order, other)
    )
    return up < 0.0 and otherwise > 0.5
