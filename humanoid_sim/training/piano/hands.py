"""Where the hands of the piano policy can be, and how they go from there: a grid of poses, and one rule.

A hand is over a quarter of a key, at one of nine levels: lifted, over the keys, down to the bottom of one. Its last
command says where it is, so the policy remembers nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.key_poses import ABOVE, LIFTED, KeyPoses
from humanoid_sim.evaluation.piano_player import HOME
from humanoid_sim.mit import FloatArray

__all__ = ["BOTTOM", "FAR", "HOVERING", "LEVELS", "QUARTERS", "Motion", "home", "pose_grid", "quarter_of"]

IntArray = npt.NDArray[np.int64]

QUARTERS = 4
"""Places a key."""
LEVELS = np.array([-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0])
"""Lifted is -1, over the keys 0, on the bottom of one 1."""
HOVERING, BOTTOM = 4, 8
"""Levels over the keys, and on the bottom of one."""
FAR = 1000.0
"""Steps that stand for never."""


def pose_grid(poses: KeyPoses, hand: int) -> FloatArray:
    """The commands of a hand, shape (places, 9, 7), rad: from its lowest key to its highest, a quarter a place."""
    low, high = poses.keys[hand][0], poses.keys[hand][-1]
    places = (high - low) * QUARTERS + 1
    grid = np.empty((places, len(LEVELS), 7))
    numbered = poses.numbered[hand]
    lifted, above = poses.table[hand, LIFTED], poses.table[hand, ABOVE]
    for place in range(places):
        key, part = low + place // QUARTERS, (place % QUARTERS) / QUARTERS
        beside = min(key + 1, high)
        over, up = (row[key] + part * (row[beside] - row[key]) for row in (above, lifted))
        nearest = key if part < 0.5 else key + 1
        for level, height in enumerate(LEVELS):
            grid[place, level] = over - height * (up - over)
            if height > 0.0:  # only over a key's middle
                mixture = poses.stroke(nearest, float(height))
                grid[place, level] = sum(share * numbered[number] for number, share in mixture.items())
    return grid


def quarter_of(poses: KeyPoses, hand: int, key: int) -> int:
    """The place of a hand over a key."""
    return (key - poses.keys[hand][0]) * QUARTERS


def home(poses: KeyPoses) -> IntArray:
    """Shape (2, 2): place and level of each hand before the first step."""
    return np.array([[quarter_of(poses, hand, HOME[hand]), HOVERING] for hand in (0, 1)])


@dataclass(frozen=True, slots=True)
class Motion:
    """The rule by which a hand goes on, in policy steps of 20 ms, quarters of a key and levels."""

    lead: int = 6
    """Steps before a note's start at which its key is pressed: so long it takes until it sounds."""
    stops: int = 2
    """Steps before a note's end at which its key is released."""
    gain: float = 0.45
    """Part of the way to a key in one step."""
    fastest: int = 8
    """Quarters a step."""
    near: int = 4
    """Quarters of the way for which a hand is lifted by a level."""
    press: int = 1
    """Levels a step, on the way down to the bottom of a key."""
    release: int = 2
    """Levels a step, on every other way up or down."""

    def step(
        self, place: IntArray, level: IntArray, target: IntArray, wait: FloatArray, left: FloatArray
    ) -> tuple[IntArray, IntArray]:
        """Place and level after a step; all arrays have one shape.

        Args:
            place: over which the hand is.
            level: of it.
            target: place of its next note.
            wait: steps until that begins; 0 if it has begun.
            left: steps until it ends.
        """
        way = target - place
        part = np.clip(np.round(self.gain * way), -self.fastest, self.fastest)
        part = np.where(np.abs(way) <= 2, way, part)
        there = np.where((level <= HOVERING) & (way != 0), place + part, place).astype(np.int64)
        lifted = HOVERING - np.minimum(-(-np.abs(target - there) // self.near), HOVERING)
        presses = (way == 0) & (wait <= self.lead) & (left > self.stops)
        goal = np.where(presses, BOTTOM, np.where(level > HOVERING, HOVERING, lifted))
        rise = np.where(level >= HOVERING, self.press, self.release)
        moved = np.where(goal > level, np.minimum(level + rise, goal), np.maximum(level - self.release, goal))
        return there, moved.astype(np.int64)
