"""What turns a motor's targets into torque, in the motor frame: the MIT law, and the other run modes of the firmware.

The MIT law is the manual's: `t = kp·(p_set - p) + kd·(v_set - v) + t_ff`. Of the other modes the manuals name the loops
and their gains, not their equations; they are a position loop over a velocity loop over a current here, as their
parameters suggest, and none of this project's programs uses them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from humanoid_sim.mit import FloatArray, mit_torque

__all__ = ["MitTargets", "RunMode", "Servo", "servo_current", "wrapped"]


class RunMode(IntEnum):
    """Parameter 0x7005."""

    OPERATION = 0
    """The MIT law."""
    PROFILE_POSITION = 1
    VELOCITY = 2
    CURRENT = 3
    CYCLIC_POSITION = 4


def wrapped(position: float, position_range: float) -> float:
    """A position in [-range, range): feedback runs cyclically, it does not saturate."""
    return (position + position_range) % (2.0 * position_range) - position_range


class MitTargets:
    """Targets and limits of several motors' MIT law, and its torque. A motor that does not run has gains of zero.

    The error is taken from the position as the motor reports it, that is wrapped: a motor that crosses the end of the
    range sees its error jump by the whole range, which the manuals neither state nor exclude.
    """

    def __init__(self, limits: FloatArray) -> None:
        """`limits`: shape (m,), N·m, of each motor's torque."""
        count = len(limits)
        self.position, self.velocity, self.effort = np.zeros((3, count))
        self.stiffness, self.damping = np.zeros((2, count))
        self.limit = np.array(limits)
        """Shape (m,), N·m."""
        self._torque = np.empty(count)
        self._scratch = np.empty(count)

    def release(self, motor: int) -> None:
        """No torque."""
        self.stiffness[motor] = self.damping[motor] = self.effort[motor] = 0.0

    def torque(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """The law at wrapped positions and velocities of shape (m,); a buffer, N·m, valid until the next call."""
        return mit_torque(self, position, velocity, self.limit, out=self._torque, scratch=self._scratch)


@dataclass(slots=True)
class Servo:
    """The loops of a motor in one of the other run modes: parameters, targets and what the loops remember."""

    mode: RunMode
    current_target: float = 0.0
    """A"""
    speed_target: float = 0.0
    """rad/s"""
    position_target: float = 0.0
    """rad, multi-turn."""
    position_gain: float = 40.0
    """1/s"""
    speed_gain: float = 6.0
    """A·s/rad"""
    speed_integral_gain: float = 0.02
    """A/rad for each period of the loop."""
    speed_limit: float = math.inf
    """rad/s"""
    acceleration: float = math.inf
    """rad/s²"""
    current_limit: float = math.inf
    """A"""
    ramped_speed: float = 0.0
    """rad/s, the velocity target after the acceleration limit."""
    integral: float = 0.0
    """A"""


def servo_current(servo: Servo, position: float, velocity: float, period: float) -> float:
    """The q-axis current, A, and advance the loops by one period, s; position multi-turn rad, velocity rad/s."""
    if servo.mode is RunMode.CURRENT:
        return servo.current_target
    if servo.mode is RunMode.VELOCITY:
        speed = servo.speed_target
    else:
        error = servo.position_target - position
        speed = servo.position_gain * error
        if servo.mode is RunMode.PROFILE_POSITION and math.isfinite(servo.acceleration):
            # never faster than what the acceleration can still brake within the way that is left
            speed = math.copysign(min(abs(speed), math.sqrt(2.0 * servo.acceleration * abs(error))), error)
        speed = min(max(speed, -servo.speed_limit), servo.speed_limit)
    if servo.mode is not RunMode.CYCLIC_POSITION:
        change = servo.acceleration * period
        speed = min(max(speed, servo.ramped_speed - change), servo.ramped_speed + change)
    servo.ramped_speed = speed
    error = speed - velocity
    limit = servo.current_limit
    servo.integral = min(max(servo.integral + servo.speed_integral_gain * error, -limit), limit)
    return min(max(servo.speed_gain * error + servo.integral, -limit), limit)
