"""The commands with which each hand of a robot plays each key: inverse kinematics, and what the servos sag."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.simulation.fingers import DEPTH, HANDS, HOVER, Fingers

IntArray = npt.NDArray[np.intp]

_PRESSING = 0.3
"""N with which a finger holds a key, beyond what the key's spring needs."""
LIFTED, ABOVE, TOUCHED, PRESSED = range(4)
"""Rows of `KeyPoses.table`."""


@dataclass(frozen=True, slots=True, eq=False)
class KeyPoses:
    """Commands that have each hand over a key, and on it; the servos sag below it to where the pose is.

    The poses of a hand are numbered: 4 rows of 88 keys, and the ready pose last.
    """

    table: FloatArray
    """Shape (2, 4, 88, 7), rad: lifted, above, touched, pressed; of the nearest key where a hand does not reach one."""
    touch: FloatArray
    """Shape (88,): share of the way from above a key to on it at which the finger touches it."""
    ready: FloatArray
    """Shape (2, 7), rad: where the song begins."""
    keys: tuple[tuple[int, ...], tuple[int, ...]]
    """Those that each hand reaches."""
    arms: tuple[IntArray, IntArray]
    """Places of each arm's joints among the robot's."""

    @classmethod
    def of(cls, description: RobotDescription, keys: Collection[int] = range(KEY_COUNT)) -> KeyPoses:
        """Find the poses of a robot with a piano; takes a few seconds for all keys.

        Raises `InputError` if the robot has no piano, or a hand reaches none of the keys.
        """
        fingers = Fingers(description)
        table = np.full((len(HANDS), 4, KEY_COUNT, 7), np.nan)
        reached = []
        for hand in range(len(HANDS)):
            stiffness = description.stiffness[fingers.arms[hand]]
            strikes = fingers.reachable(hand, keys)
            if not strikes:
                raise InputError(f"{description.name}: its {HANDS[hand]} hand reaches none of the keys")
            for key, strike in strikes.items():
                force = fingers.spring_force(fingers.keys[key], DEPTH)
                poses = strike.lifted, strike.above, strike.touched, strike.pressed
                for i, (pose, pressing) in enumerate(zip(poses, (0.0, 0.0, 0.0, force + _PRESSING), strict=True)):
                    table[hand, i, key] = pose + fingers.holding_torque(hand, pose, pressing) / stiffness
            reached.append(tuple(strikes))
            nearest = np.clip(np.arange(KEY_COUNT), min(strikes), max(strikes))
            table[hand] = table[hand][:, nearest]
        ready = np.stack([fingers.ready[arm] for arm in fingers.arms])
        drop = [fingers.tip_above(key, 0.0)[2] - fingers.tip_above(key, 0.0, DEPTH)[2] for key in fingers.keys]
        touch = HOVER / (HOVER + np.array(drop))
        return cls(table, touch, ready, (reached[0], reached[1]), (fingers.arms[0], fingers.arms[1]))

    @property
    def numbered(self) -> FloatArray:
        """Shape (2, 353, 7), rad: all poses of each hand."""
        rows = self.table.reshape(len(HANDS), -1, 7)
        return np.concatenate([rows, self.ready[:, None]], axis=1)

    def stroke(self, key: int, share: float) -> Mixture:
        """Return the poses between which a hand is, a share of the way from above a key to on it."""
        touch = self.touch[key]
        if share < touch:
            return between(pose_number(ABOVE, key), pose_number(TOUCHED, key), share / touch)
        return between(pose_number(TOUCHED, key), pose_number(PRESSED, key), (share - touch) / (1.0 - touch))


Mixture = dict[int, float]
"""Numbers of poses and their shares, which add up to 1."""
MIXED = 4
"""Most poses of a mixture."""
READY = 4 * KEY_COUNT
"""Number of the ready pose."""


def pose_number(row: int, key: int) -> int:
    """Return the number of a pose: its row of `KeyPoses.table`, and the key."""
    return row * KEY_COUNT + key


def between(a: int, b: int, share: float) -> Mixture:
    """Return a share of the way from one pose to another."""
    if a == b:
        return {a: 1.0}
    return {number: part for number, part in ((a, 1.0 - share), (b, share)) if part}
