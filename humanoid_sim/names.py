"""Names of things in pairs and near one another: the known name that was probably meant, and left and right."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence


def near_miss(name: str, known: Iterable[str]) -> str:
    """Return the one of the known names that was probably meant; empty if none is close."""
    plain = {_plain(other): other for other in known}
    close = difflib.get_close_matches(_plain(name), list(plain), n=1, cutoff=0.75)
    # left_knee and right_knee, rs-02 and rs-04 are close in letters and far in meaning.
    return plain[close[0]] if close and _which(close[0]) == _which(_plain(name)) else ""


def _plain(name: str) -> str:
    """Return a name with sides as words, without what exporters add, an option's dashes and a folder."""
    text = name.lstrip("-").rpartition("/")[2].lower().replace("-", "_").replace(" ", "_")
    text = re.sub(r"^joint_|_(joint|link|dof|motor)$", "", text)
    return re.sub(r"^l_|_l$", "_left_", re.sub(r"^r_|_r$", "_right_", text)).strip("_")


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
