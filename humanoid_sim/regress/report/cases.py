"""Which cases moved: a metric case by case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.report.drawing import axis_label, style_axes
from humanoid_sim.regress.report.groups import axis_limits, draw_dots, groups
from humanoid_sim.regress.report.pairs import by_case, pair_up
from humanoid_sim.regress.report.palette import COLOURS, candidate_colour
from humanoid_sim.regress.results import MetricInfo, Results
from humanoid_sim.regress.words import displayed_unit

__all__ = ["draw_cases", "draw_changes"]

_ROW = 0.7
"""Of the height of a case is used by its policies."""


@dataclass(frozen=True, slots=True)
class _Row:
    """One policy's values of one case, in the unit that is shown."""

    dots: FloatArray
    """Shape (K,), one per episode that has the metric."""
    mean: float


def _row(values: Sequence[float | None], metric: MetricInfo) -> _Row | None:
    """A row of values; of a share the mean alone says all."""
    factor, _ = displayed_unit(metric.unit)
    known = np.array([factor * value for value in values if value is not None], dtype=np.float64)
    if not known.size:
        return None
    return _Row(np.empty(0) if metric.unit == "share" else known, float(known.mean()))


_Rows = Mapping[str, _Row | None]
"""By case."""


def draw_changes(axes: Axes, results: Results, metric: MetricInfo) -> None:
    """Candidate less baseline, seed by seed; the shaded side is worse than is tolerated."""
    policies = []
    for candidate in results.candidates:
        found: dict[str, list[float | None]] = {}
        for pair in pair_up(candidate.run, results.baseline):
            found.setdefault(pair.candidate.case, []).append(pair.change(metric))
        policies.append({case: _row(values, metric) for case, values in found.items()})
    low, high = _limits(policies, 0.0)
    edge = _tolerated(results, metric)
    if edge is not None:
        low, high = min(low, 1.4 * edge, -0.4 * edge), max(high, 1.4 * edge, -0.4 * edge)
        beyond = (edge, high) if metric.better == "lower" else (low, edge)
        axes.axvspan(*beyond, color=COLOURS["worse"], alpha=0.10, linewidth=0)
    axes.axvline(0.0, color=COLOURS["faint"], linewidth=0.8)
    colours = [candidate_colour(i) for i in range(len(policies))]
    _draw(axes, results.suite.cases, policies, colours, (low, high))
    axes.set_xlabel(f"candidate − baseline [{displayed_unit(metric.unit)[1]}]")
    axes.set_title("change by case")


def draw_cases(axes: Axes, results: Results, metric: MetricInfo) -> None:
    """The values themselves, where there is nothing to subtract seed by seed."""
    shown = groups(results)
    policies = [
        {
            case: _row([episode.metrics.get(metric.name) for episode in episodes], metric)
            for case, episodes in by_case(group.run.episodes).items()
        }
        for group in shown
    ]
    _draw(axes, results.suite.cases, policies, [group.colour for group in shown], _limits(policies))
    axes.set_xlabel(axis_label(metric.name, metric.unit))
    axes.set_title("by case")


def _limits(policies: Sequence[_Rows], *more: float) -> tuple[float, float]:
    rows = [row for rows in policies for row in rows.values() if row is not None]
    return axis_limits(np.concatenate([*(row.dots for row in rows), [row.mean for row in rows], more]))


def _tolerated(results: Results, metric: MetricInfo) -> float | None:
    """The change from which on a candidate is worse than the suite tolerates, in the unit that is shown."""
    tolerances = [
        comparison.tolerance
        for candidate in results.candidates
        for comparison in candidate.comparisons
        if comparison.metric == metric.name and comparison.tolerance is not None
    ]
    if not tolerances:
        return None
    return displayed_unit(metric.unit)[0] * min(tolerances) * (1.0 if metric.better == "lower" else -1.0)


def _draw(
    axes: Axes,
    cases: Sequence[str],
    policies: Sequence[_Rows],
    colours: Sequence[str],
    limits: tuple[float, float],
) -> None:
    """A row per case, in it one per policy: a dot per episode, and a tick at the mean."""
    height = _ROW / max(len(policies), 1)
    for i, (rows, colour) in enumerate(zip(policies, colours, strict=True)):
        for place, case in enumerate(cases):
            row = rows.get(case)
            if row is None:
                continue
            y = -place + 0.5 * _ROW - height * (i + 0.5)
            draw_dots(axes, row.dots, y - 0.25 * height, 0.5 * height, colour)
            axes.plot([row.mean, row.mean], [y - 0.4 * height, y + 0.4 * height], color=colour, linewidth=2.2)
    axes.set_xlim(*limits)
    axes.set_yticks([-place for place in range(len(cases))], list(cases))
    axes.set_ylim(0.5 - len(cases), 0.5)
    style_axes(axes, grid="x")
