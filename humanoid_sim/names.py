"""Names that come in pairs, left and right."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
