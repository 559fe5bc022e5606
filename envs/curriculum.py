"""Curricula: how much of the randomisation and of the commands counts, as a function of the progress of training."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.simulation.batch.draws import FULL, SCALED

Curriculum = Callable[[float], Mapping[str, float]]
"""Amounts in [0, 1] by name, as a function of the progress in [0, 1]. Names are `commands`, `terrain`,
`randomisation`, and any of its fields, which counts more than that. What is not named counts in full."""

_COMMANDS, _TERRAIN, _RANDOMISATION = "commands", "terrain", "randomisation"


@dataclass(frozen=True, slots=True)
class Amounts:
    """Amounts that a curriculum gives at one moment."""

    commands: float = 1.0
    """Amount of the velocity commands that a task draws."""
    terrain: float = 1.0
    """Amount of the hardness of a terrain: 0 for its easiest tiles alone."""
    randomisation: Mapping[str, float] = field(default_factory=lambda: FULL)
    """Amounts by field."""


def amounts_at(curriculum: Curriculum | None, progress: float) -> Amounts:
    """Return what counts in episodes that begin at this progress.

    Raises `InputError` if the curriculum names what there is not, or an amount is not a number in [0, 1].
    """
    if curriculum is None:
        return Amounts()
    said = dict(curriculum(progress))
    known = (_COMMANDS, _TERRAIN, _RANDOMISATION, *SCALED)
    require_known("amount", said, known, "curriculum: ")
    for name, amount in said.items():
        if not (isinstance(amount, int | float) and 0.0 <= amount <= 1.0):
            raise InputError(
                f"curriculum: {name} is {amount!r} at the progress {progress:g}, expected a number from 0 to 1"
            )
    fields = {name: said.get(name, said.get(_RANDOMISATION, 1.0)) for name in SCALED}
    return Amounts(float(said.get(_COMMANDS, 1.0)), float(said.get(_TERRAIN, 1.0)), fields)


def scheduled(points: Mapping[str, Any]) -> Curriculum:
    """Give a curriculum of points: amounts that change evenly from one progress to the next, and hold before and after.

    Raises `InputError` if a name is unknown, or a value is neither an amount nor such a list.

    Args:
        points: for each name one amount, or pairs of a progress and an amount, such as `[[0.5, 0.0], [1.0, 1.0]]`.
    """
    amounts_at(lambda _: dict.fromkeys(points, 0.0), 0.0)  # which knows the names
    lines = {name: _line(name, value) for name, value in points.items()}

    def curriculum(progress: float) -> dict[str, float]:
        return {name: float(np.interp(progress, at, amounts)) for name, (at, amounts) in lines.items()}

    return curriculum


def _line(name: str, value: Any) -> tuple[list[float], list[float]]:
    """Return the progress of each point, ascending, and its amount."""
    pairs = [[0.0, value]] if _is_share(value) else value
    if not (
        isinstance(pairs, list)
        and pairs
        and all(isinstance(pair, list) and len(pair) == 2 and all(map(_is_share, pair)) for pair in pairs)
    ):
        raise InputError(
            f"curriculum: {name} is {value!r}, expected a number from 0 to 1, or pairs [progress, amount] of such"
        )
    at = [float(progress) for progress, _ in pairs]
    if any(after <= before for before, after in pairwise(at)):
        raise InputError(f"curriculum: {name} is {value!r}, expected each progress to be greater than the one before")
    return at, [float(amount) for _, amount in pairs]


def _is_share(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= 1.0
