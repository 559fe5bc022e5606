"""Names of joints: in pairs, left and right, and in a list."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

_LISTED = 3  # joints that a message names before it counts them
_SIDE = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}


def mirrored_pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs (left, right) among names that differ in their side alone: left and right, or l and r."""
    pairs = []
    for name in names:
        for side in re.finditer("|".join(_SIDE), name):
            other = name[: side.start()] + _SIDE[side[0]] + name[side.end() :]
            if other in names:
                pairs.append((name, other))
    return pairs


def list_joints(joints: Sequence[str] | Mapping[str, str], count: int = 0) -> str:
    """Return `a (1), b (2), c (3) and 12 more`; `all 29 joints` where `count`, the number of joints, are given."""
    if not isinstance(joints, Mapping) and len(joints) == count > 1:
        return f"all {count} joints"
    items = [f"{name} ({text})" for name, text in joints.items()] if isinstance(joints, Mapping) else list(joints)
    more = len(items) - _LISTED
    return ", ".join(items) if more <= 1 else f"{', '.join(items[:_LISTED])} and {more} more"
