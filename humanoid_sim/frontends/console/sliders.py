"""All joints by sliders in REMOTE: bounded commands that change gradually.

Each joint goes where its slider is, with STANDBY's gains. Every value goes from what was commanded before to where it
should be at a limited rate, beginning with the damped hold that REMOTE has without commands: nothing jumps.
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.damping import damped_command
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.robots.description import RobotDescription

_SPEED = 1.0  # rad/s at which the commanded position moves
_RAMP = 1.0  # s in which the gains come in
_FURTHEST = 0.3  # rad by which a slider leads its joint at most
_SPRING_SHARE = 0.5  # of the effort limit for K_p times that distance; the following guard trips at 0.8
_LONGEST_STEP = 0.05  # s that one step may cover


def slider_limits(robot: RobotDescription) -> FloatArray:
    """Return the lowest and the highest position of each slider, shape (n, 2), rad."""
    return np.clip(np.stack([robot.lower, robot.upper], axis=1), -np.pi, np.pi)


class JointSliders:
    """Commands for one robot. Positions have shape (n,), rad, measured, finite."""

    def __init__(self, robot: RobotDescription, position: FloatArray) -> None:
        """Begin with all sliders where the joints are."""
        self._robot, self._limits = robot, slider_limits(robot)
        standby = robot.standby_controller_a
        self._gains = np.array([standby.target_stiffness, standby.target_damping])
        self._reach = np.minimum(_FURTHEST, _SPRING_SHARE * robot.effort_limit / np.maximum(self._gains[0], 1e-6))
        self.goals = position.copy()
        """Shape (n,), rad: where the sliders are."""
        self.restart(position)

    def passive(self, position: FloatArray) -> MITCommand:
        """Return what REMOTE does without commands."""
        return damped_command(position, self._robot.passive_damping)

    def restart(self, position: FloatArray) -> None:
        """Go on after commands were missing: the joints are where they are, damped."""
        passive = self.passive(position)
        self._position, self._ramp = passive.position, np.stack([passive.stiffness, passive.damping])

    def step(self, position: FloatArray, elapsed: float) -> MITCommand:
        """Return the command after `elapsed` s."""
        seconds = min(max(elapsed, 0.0), _LONGEST_STEP)
        away = np.abs(self._position - position)
        wanted = np.clip(self.goals, *self._limits.T)
        moved = self._position + np.clip(wanted - self._position, -_SPEED * seconds, _SPEED * seconds)
        is_near = np.abs(moved - position) <= np.maximum(self._reach, away)  # one that is led by hand is not pulled at
        self._position = np.where(is_near, moved, self._position)
        most = seconds / _RAMP * np.maximum(self._gains, self._robot.passive_damping)
        self._ramp = self._ramp + np.clip(self._gains - self._ramp, -most, most)
        zeros = np.zeros_like(position)
        return MITCommand(self._position, zeros, zeros, *self._ramp)
