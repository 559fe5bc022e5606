"""The ways of the policy's hands: from over one key to over another, as fast as the motors can follow."""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.evaluation.key_poses import ABOVE, LIFTED, PRESSED
from humanoid_sim.evaluation.piano_player import Course, PianoPlayer, smooth
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.fingers import Fingers
from humanoid_sim.simulation.kinematics import MassMatrix

__all__ = ["Ways"]

_WAY, _RELEASE = 1.4, 1.0
"""Share of the effort that is left beside an arm's weight: what a way, and a release, need at most. The peaks of a way
are short, so that more than 1 does no harm; with 2.0 a stretched arm passed its key by 20 mm, and sank onto others."""
_LIFTED = 8.0
"""Semitones from which on a hand is lifted all the way."""
_ROUND = 12.0
"""Semitones up to which a hand rises and sinks all the time; on longer ways it stays up in between."""
_STEEPER = 0.008
"""By which share of its time it rises faster for each semitone beyond, down to"""
_STEEPEST = 0.25
"""this share: straight between far poses lie other keys."""
_STEPS = 24
"""In which an effort is measured; it falls with the square of the time."""


class Ways:
    """The ways of the hands of one robot, at the player's pace or slower."""

    def __init__(self, player: PianoPlayer, description: RobotDescription, policy_dt: float) -> None:
        """Prepare.

        Args:
            player: of the same robot and `policy_dt`, whose pace none exceeds.
            description: of the robot.
            policy_dt: s between two commands.
        """
        self.player, self._dt = player, policy_dt
        self._poses, self._mass, self._fingers = player.poses, MassMatrix(description), Fingers(description)
        self._limit = description.effort_limit
        self._room: dict[tuple[int, int], FloatArray] = {}

    def __call__(self, hand: int, origin: int, key: int) -> Course:
        """Return the commands from over one key to over another, the other arm at rest."""
        planned = self._planned(hand, origin, key, _STEPS)
        room = np.minimum(self._beside_weight(hand, origin), self._beside_weight(hand, key))
        steps = max(self._needed(hand, planned, _WAY * room), self.player.way_steps(origin, key))
        return self.player.led(self._planned(hand, origin, key, steps))[1:, self._poses.arms[hand]]

    def release(self, hand: int, key: int) -> Course:
        """Return the commands from the bottom of a key to over it, the other arm at rest."""
        rise = smooth(np.linspace(0.0, 1.0, _STEPS + 1))[:, None]
        above, pressed = (self._poses.table[hand, row, key] for row in (ABOVE, PRESSED))
        planned = self._resting(_STEPS)
        planned[:, self._poses.arms[hand]] = pressed + rise * (above - pressed)
        needed = self._needed(hand, planned, _RELEASE * self._beside_weight(hand, key))
        return self.player.release(hand, key, needed)

    def _needed(self, hand: int, planned: FloatArray, effort: FloatArray) -> int:
        """Return steps, if poses planned for `_STEPS` are to need no more than an effort, shape (7,), N·m."""
        arm = self._poses.arms[hand]
        padded = np.concatenate([planned[:1], planned, planned[-1:]])
        acceleration = (padded[2:] - 2.0 * planned + padded[:-2]) / self._dt**2
        torque = np.array([(self._mass(pose) @ a)[arm] for pose, a in zip(planned, acceleration, strict=True)])
        return math.ceil(_STEPS * math.sqrt((np.abs(torque) / effort).max()))

    def _beside_weight(self, hand: int, key: int) -> FloatArray:
        """Shape (7,), N·m: what the motors have left while the hand is over a key."""
        if (hand, key) not in self._room:
            weight = self._fingers.holding_torque(hand, self._poses.table[hand, ABOVE, key], 0.0)
            self._room[hand, key] = self._limit[self._poses.arms[hand]] - np.abs(weight)
        return self._room[hand, key]

    def _planned(self, hand: int, origin: int, key: int, steps: int) -> FloatArray:
        """Return the poses on a way, shape (steps + 1, n), rad: up, along the line over all keys, and down."""
        arm, table = self._poses.arms[hand], self._poses.table[hand]
        time = np.linspace(0.0, 1.0, steps + 1)
        share = smooth(time)
        along = origin + share * (key - origin)
        low = np.minimum(along.astype(int), KEY_COUNT - 2)
        beyond = (along - low)[:, None]
        line = (1.0 - beyond) * table[LIFTED, low] + beyond * table[LIFTED, low + 1]
        lift = _lift(time, abs(key - origin))[:, None]
        straight = table[ABOVE, origin] + share[:, None] * (table[ABOVE, key] - table[ABOVE, origin])
        planned = self._resting(steps)
        planned[:, arm] = lift * line + (1.0 - lift) * straight
        return planned

    def _resting(self, steps: int) -> FloatArray:
        """Shape (steps + 1, n), rad: both arms where they begin."""
        planned = np.empty((steps + 1, len(self._limit)))
        for side, arm in enumerate(self._poses.arms):
            planned[:, arm] = self._poses.ready[side]
        return planned


def _lift(time: FloatArray, way: int) -> FloatArray:
    """Return how far up a hand is on a way of some semitones: 0 over the keys, 1 on the line over all of them."""
    height = smooth(min(way / _LIFTED, 1.0))
    if way <= _ROUND:
        return height * np.sin(math.pi * time) ** 2
    rise = max(0.5 - _STEEPER * (way - _ROUND), _STEEPEST)
    return height * smooth(np.minimum(np.minimum(time, 1.0 - time) / rise, 1.0))
