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
_WHITE = frozenset({0, 2, 4, 5, 7, 9, 11})  # pitch classes of the white keys


def is_white(key: int) -> bool:
    """Return whether a key, 0 is A0, is a white one."""
    return (key + FIRST_NOTE) % 12 in _WHITE


def key_joint_names() -> tuple[str, ...]:
    """Names of the 88 joints, from the lowest key; those of every piano are the same."""
    return tuple(f"{'white' if is_white(key) else 'black'}_joint_{key}" for key in range(KEY_COUNT))
