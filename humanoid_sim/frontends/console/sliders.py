"""One joint by sliders in REMOTE: bounded commands that change gradually.

The chosen joint goes where its sliders are; all others hold the positions that they had when they were last left, with
STANDBY's gains. Every value goes from what was commanded before to where it should be at a limited rate, beginning with
the damped hold that REMOTE has without commands: nothing jumps.
"""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.controllers.damping import damped_command
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS

_SPEED = 1.0  # rad/s at which the commanded position moves
_RAMP = 2.0  # s in which a gain goes through its whole range
_GAIN_SHARE = 2.0  # largest gain of a slider, as a multiple of STANDBY's
_FURTHEST = 0.3  # rad between the commanded position and the joint: raising K_p never pulls at more than that
_SPRING_SHARE = 0.5  # of the effort limit for K_p times that distance; the following guard trips at 0.8
_LONGEST_STEP = 0.05  # s that one step may cover
_POSITION, _STIFFNESS, _DAMPING = range(3)  # rows of `_rows`


class JointSliders:
    """Commands for one robot in STANDBY's pose `a` or `b`. Positions have shape (n,), rad, measured, finite."""

    def __init__(self, robot: RobotDescription, pose: str) -> None:
        """Choose no joint yet."""
        standby = robot.standby_controller_b if pose == "b" else robot.standby_controller_a
        self._robot = robot
        self._gains = np.array([standby.target_stiffness, standby.target_damping])
        largest = _GAIN_SHARE * np.maximum(self._gains, [robot.stiffness, robot.passive_damping])
        for i, joint in enumerate(robot.joints):
            model = None if joint.motor is None else MOTORS.get(joint.motor.model)
            if model is not None:
                largest[:, i] = np.minimum(largest[:, i], [model.stiffness, model.damping])
        self._largest_gains = largest
        self._rates = np.vstack([np.full(robot.joint_count, _SPEED), largest / _RAMP])
        self.joint: int | None = None

    def passive(self, position: FloatArray) -> MITCommand:
        """Return what REMOTE does without commands."""
        return damped_command(position, self._robot.passive_damping)

    def choose(self, joint: int, position: FloatArray) -> None:
        """Move this joint from here on, with gains 0 at first; the one before is held where it is."""
        if self.joint is None:
            self.restart(position)
            self._held = position.copy()
        else:
            self._held[self.joint] = position[self.joint]
        self.joint, described = joint, self._robot.joints[joint]
        here = float(position[joint])
        lower = described.lower if math.isfinite(described.lower) else here - math.pi
        upper = described.upper if math.isfinite(described.upper) else here + math.pi
        self.limits = np.array([(lower, upper), *((0.0, gain) for gain in self._largest_gains[:, joint])])
        """Shape (3, 2): lowest and highest position, rad, K_p, N·m/rad, and K_d, N·m·s/rad."""
        self.goals = np.clip([here, 0.0, 0.0], self.limits[:, 0], self.limits[:, 1])
        """Shape (3,): where the sliders are, in the units of `limits`."""

    def restart(self, position: FloatArray) -> None:
        """Go on after commands were missing: the joints are where they are, damped."""
        passive = self.passive(position)
        self._rows = np.stack([passive.position, passive.stiffness, passive.damping])

    def step(self, position: FloatArray, elapsed: float) -> MITCommand:
        """Return the command after `elapsed` s."""
        j = self.joint
        assert j is not None
        wanted = np.vstack([self._held, self._gains])
        wanted[:, j] = np.clip(self.goals, self.limits[:, 0], self.limits[:, 1])
        most = self._rates * min(max(elapsed, 0.0), _LONGEST_STEP)
        rows = self._rows + np.clip(wanted - self._rows, -most, most)
        away, most_effort = _FURTHEST, _SPRING_SHARE * self._robot.joints[j].effort_limit
        if rows[_STIFFNESS, j] * away > most_effort:
            away = most_effort / rows[_STIFFNESS, j]
        rows[_POSITION, j] = np.clip(rows[_POSITION, j], position[j] - away, position[j] + away)
        self._rows, zeros = rows, np.zeros_like(position)
        return MITCommand(rows[_POSITION], zeros, zeros, rows[_STIFFNESS], rows[_DAMPING])
