"""Measurement of figures: medians over repetitions, ratios pair by pair."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

__all__ = ["Row", "paired_ratio", "row_of", "seconds"]


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    name: str
    value: float
    unit: str
    """`ratio`, `µs`, or what else `value` is in."""
    low: float
    """Least of the repetitions."""
    high: float
    """Greatest of the repetitions."""
    target: float | None = None
    """Goal of the project, not to be exceeded, or to be reached; None: for information."""
    detail: str = ""
    at_least: bool = False
    """The target is a least value: of a speed, not of a cost."""

    @property
    def is_met(self) -> bool:
        """Return whether the value is within its target."""
        if self.target is None:
            return True
        return self.value >= self.target if self.at_least else self.value <= self.target


def seconds(action: Callable[[], object]) -> float:
    """Wall time of one call, s."""
    begin = perf_counter()
    action()
    return perf_counter() - begin


def row_of(name: str, values: Iterable[float], unit: str) -> Row:
    """Return a row without a target, of repeated measurements."""
    ordered = sorted(values)
    return Row(name, ordered[len(ordered) // 2], unit, ordered[0], ordered[-1])


def paired_ratio(
    name: str,
    action: Callable[[], object],
    bare: Callable[[], object],
    repetitions: int,
    target: float | None,
    describe: Callable[[float, float], str],
    *,
    speed: bool = False,
    prepare: Callable[[], object] = lambda: None,
) -> Row:
    """Time `action` and `bare` in turn; the row is the median of their ratios, after one pair that is not counted.

    `describe` makes the row's detail from the median times in s of both; `prepare` is called before each, untimed.
    With `speed` the ratio is that of speeds instead of times, and the target the least that is wanted.
    """

    def once(timed: Callable[[], object]) -> float:
        prepare()
        return seconds(timed)

    pairs = [(once(action), once(bare)) for _ in range(repetitions + 1)][1:]
    ratios = [b / a if speed else a / b for a, b in pairs]
    detail = describe(statistics.median(a for a, _ in pairs), statistics.median(b for _, b in pairs))
    return Row(name, statistics.median(ratios), "ratio", min(ratios), max(ratios), target, detail, speed)
