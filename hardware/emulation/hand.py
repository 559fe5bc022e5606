"""A hand that leads the joints of an emulated robot from limit to limit, as an operator does to calibrate it."""

from __future__ import annotations

import math

from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.robots.description import RobotDescription

__all__ = ["HandSweep"]

_TIME_PER_JOINT = 4.0
"""s from where the joint was to one limit, to the other, and back."""
_BEYOND = 0.1
"""rad beyond the limits, so that the joint reaches its stop."""


class HandSweep:
    """Leads one joint after the other to its lower and its upper limit and back, then begins again."""

    def __init__(self, description: RobotDescription, motors: VirtualMotors) -> None:
        """Take hold at the present positions."""
        position = motors.truth.joint_position
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        self._rest = {joint.name: float(position[i]) for i, joint in driven}
        self._range = {joint.name: (joint.lower, joint.upper) for _, joint in driven}
        self._motors = motors
        self._begin = motors.time

    def update(self, time: float) -> None:
        """Move the hand to where it is at `time`, s, on the motors' clock."""
        turn, phase = divmod((time - self._begin) / _TIME_PER_JOINT, 1.0)
        name = list(self._rest)[int(turn) % len(self._rest)]
        rest = self._rest[name]
        lower, upper = self._range[name]
        swing = math.sin(2.0 * math.pi * phase)
        reach = upper + _BEYOND - rest if swing > 0.0 else rest - lower + _BEYOND
        self._motors.move_by_hand({**self._rest, name: rest + swing * reach})
