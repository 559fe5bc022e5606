"""A hand that leads the joints of an emulated robot from limit to limit, as an operator does to calibrate it."""

from __future__ import annotations

import math
from collections.abc import Mapping

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription

__all__ = ["HandSweep"]

_LIFT_TIME = 2.0
"""s"""
_TIME_PER_JOINT = 4.0
"""s to one limit, to the other, and back."""
_BEYOND = 0.05
"""rad beyond the limits, so that the joint reaches its stop."""


class HandSweep:
    """Lifts all joints to 0, then leads one after the other to its upper and its lower limit and back, again and again.

    At 0 the Lite stands as a T, where all joints but one have their whole range free. The raised arm hits the head
    before the shoulder's roll is at its stop: that joint needs an operator, who turns the arm past it.
    """

    def __init__(self, description: RobotDescription, position: FloatArray) -> None:
        """Take hold at the present positions, shape (n,), rad."""
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        self._start = {joint.name: float(position[i]) for i, joint in driven}
        self._range = {joint.name: (joint.lower, joint.upper) for _, joint in driven}

    def at(self, time: float) -> Mapping[str, float]:
        """Where the hand leads each joint, rad, `time` s after it took hold."""
        left = max(1.0 - time / _LIFT_TIME, 0.0)
        led = {name: left * start for name, start in self._start.items()}
        turn, phase = divmod(max(time - _LIFT_TIME, 0.0) / _TIME_PER_JOINT, 1.0)
        name = list(led)[int(turn) % len(led)]
        lower, upper = self._range[name]
        swing = math.sin(2.0 * math.pi * phase)
        led[name] += swing * (upper + _BEYOND if swing > 0.0 else _BEYOND - lower)
        return led
