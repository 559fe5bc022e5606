"""How the episodes of a metric are distributed, policy by policy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.report.cases import draw_cases, draw_changes
from humanoid_sim.regress.report.drawing import axis_label, drawing, style_axes
from humanoid_sim.regress.report.groups import Group, axis_limits, draw_dots, groups
from humanoid_sim.regress.report.pairs import mean_over_cases, metric_values
from humanoid_sim.regress.results import MetricInfo, Results
from humanoid_sim.regress.words import displayed_unit

__all__ = ["distribution_plot", "varies"]

_CLOUD, _GAP, _DOTS = 0.42, 0.08, 0.30
"""Heights, in rows: of the density above a row's line, of the gap below it, and of the dots below that."""


def varies(results: Results, metric: MetricInfo) -> bool:
    """Whether there is anything to see: not the same value in every episode of every policy."""
    values = np.concatenate([metric_values(group.run.episodes, metric.name) for group in groups(results)])
    return values.size > 0 and bool((values != values[0]).any())


def distribution_plot(results: Results, metric: MetricInfo, name: str) -> str:
    """SVG: every policy's episodes to the left, and to the right what changed in each case.

    Args:
        results: of the run.
        metric: to be shown.
        name: unique in the page.
    """
    rows = groups(results)
    paired = results.baseline is not None and all(
        comparison.paired for candidate in results.candidates for comparison in candidate.comparisons
    )
    height = 0.75 + max(0.62 * len(rows), 0.30 * len(results.suite.cases))
    with drawing(height, name, f"{metric.name}: distribution over the episodes, and by case") as sheet:
        left, right = sheet.figure.subplots(1, 2, width_ratios=[3, 2])
        if metric.unit == "share":
            _draw_shares(left, rows, metric)
        else:
            _draw_rows(left, rows, metric)
        if paired:
            draw_changes(right, results, metric)
        else:
            draw_cases(right, results, metric)
    return sheet.svg


def _draw_rows(axes: Axes, rows: Sequence[Group], metric: MetricInfo) -> None:
    """Every episode a dot under the density of them all."""
    factor, _ = displayed_unit(metric.unit)
    values = [factor * metric_values(group.run.episodes, metric.name) for group in rows]
    for i, group in enumerate(rows):
        mean = mean_over_cases(group.run.episodes, metric.name)
        if mean is None:
            continue
        mean, bottom = factor * mean, -i - _GAP - _DOTS
        _draw_cloud(axes, values[i], -i, group.colour)
        draw_dots(axes, values[i], bottom, _DOTS, group.colour)
        axes.plot([mean, mean], [bottom, -i + _CLOUD], color=group.colour, linewidth=1.0, dashes=(3, 2))
        _write(axes, f"{mean:.4g}", mean, -i + _CLOUD, (3, -1), "top", group.colour)
    axes.set_xlim(*axis_limits(np.concatenate(values)))
    axes.set_title("episodes")
    _name_rows(axes, rows, metric)


def _draw_cloud(axes: Axes, values: FloatArray, y: float, colour: str) -> None:
    """A kernel density over the row; only a line where all values are one."""
    axes.plot([values.min(), values.max()], [y, y], color=colour, linewidth=0.8)
    deviation = float(values.std())
    if deviation <= 1e-9 * abs(float(values.mean())):
        return
    width = 0.53 * deviation * values.size**-0.2  # half of Silverman's rule, which is for one hill: cases make several
    x = np.linspace(values.min() - 2.5 * width, values.max() + 2.5 * width, 160)
    density = np.exp(-0.5 * ((x[:, None] - values) / width) ** 2).sum(axis=1)
    axes.fill_between(x, y, y + _CLOUD * density / density.max(), color=colour, alpha=0.28, linewidth=0)


def _draw_shares(axes: Axes, rows: Sequence[Group], metric: MetricInfo) -> None:
    """A bar per policy: an episode either is one of them or is not."""
    factor, _ = displayed_unit(metric.unit)
    shares = []
    for i, group in enumerate(rows):
        values = metric_values(group.run.episodes, metric.name)
        shares.append(factor * float(values.mean()) if values.size else 0.0)
        axes.barh(-i, shares[-1], height=0.5, color=group.colour, alpha=0.6)
        _write(axes, f"{values.sum():.4g} of {values.size}", shares[-1], -i, (5, 0), "center", group.colour)
    axes.set_xlim(0.0, 1.2 * max(shares) or 1.0)
    axes.set_title("share of the episodes")
    _name_rows(axes, rows, metric)


def _write(axes: Axes, words: str, x: float, y: float, offset: tuple[float, float], anchor: str, colour: str) -> None:
    axes.annotate(words, (x, y), offset, textcoords="offset points", va=anchor, fontsize=8, color=colour)


def _name_rows(axes: Axes, rows: Sequence[Group], metric: MetricInfo) -> None:
    axes.set_yticks([-i for i in range(len(rows))], [group.name for group in rows])
    axes.set_ylim(0.5 - len(rows), 0.55)
    axes.set_xlabel(axis_label(metric.name, metric.unit))
    style_axes(axes, grid="x")
