"""The piano in front of a robot: 88 hinged keys with springs, passive joints of the robot's MJCF.

The figures of the shipped ones are those of T-K-233/Robot-Descriptions, commit 44985c9 (its piano generator,
Apache-2.0, goes back to RoboPianist, Zakka et al. 2023). The piano frame has its origin on top of the white keys, at
their back edge, in the middle of the keyboard; +x points towards the player, +z up, low notes are at -y. A positive
angle presses a key.
"""

from __future__ import annotations

KEY_COUNT = 88
FIRST_NOTE = 21  # MIDI number of the lowest key, A0
TRIGGER = 0.70  # share of its travel beyond which a key sounds, strictly
_BLACK = frozenset({1, 3, 6, 8, 10})  # pitch classes


def key_joint_names() -> tuple[str, ...]:
    """Return the names of the 88 joints, from the lowest key; those of every piano are the same."""
    colours = ("black" if (key + FIRST_NOTE) % 12 in _BLACK else "white" for key in range(KEY_COUNT))
    return tuple(f"{colour}_joint_{key}" for key, colour in enumerate(colours))
