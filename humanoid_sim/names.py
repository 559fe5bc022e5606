"""Suggestion of the known name that was probably meant: for messages about names that do not exist."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence

_AFFIXES = re.compile(r"^(joint_)|(_joint|_link|_dof|_motor)$")
_SIDES = ((r"^l_", "left_"), (r"^r_", "right_"), (r"_l$", "_left"), (r"_r$", "_right"))


def near_miss(name: str, known: Iterable[str]) -> str:
    """Return the one of the known names that was probably meant; empty if none is close."""
    plain = {_plain(other): other for other in known}
    wanted = _plain(name)
    if wanted in plain:
        return plain[wanted]
    shuffled = [other for other in plain if sorted(other.split("_")) == sorted(wanted.split("_"))]
    close = shuffled or difflib.get_close_matches(wanted, list(plain), n=1, cutoff=0.75)
    # left_knee and right_knee, rs-02 and rs-04 are close in letters and far in meaning.
    if close and _which(close[0]) == _which(wanted):
        return plain[close[0]]
    return ""


def _plain(name: str) -> str:
    """Return a name without what exporters add, drop or spell differently, and without an option's dashes."""
    text = name.lstrip("-").rpartition("/")[2].lower().replace("-", "_").replace(" ", "_")
    text = _AFFIXES.sub("", text)
    for pattern, side in _SIDES:
        text = re.sub(pattern, side, text)
    return text


def _which(name: str) -> list[str]:
    """Side and numbers: what tells things of one kind apart."""
    return re.findall(r"left|right|[0-9]+", name)


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
