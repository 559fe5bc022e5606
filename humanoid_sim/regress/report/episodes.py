"""The episodes one by one: a map of all of them, and the worst by name."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from humanoid_sim.regress.report.drawing import axis_label, drawing
from humanoid_sim.regress.report.markup import table, text
from humanoid_sim.regress.report.pairs import pair_up, worst
from humanoid_sim.regress.report.palette import COLOURS
from humanoid_sim.regress.results import Candidate, Results
from humanoid_sim.regress.words import displayed_unit, quantity

__all__ = ["episode_map", "worst_table"]

_WORST = 10
_SHADES = 41
"""Of the map; from 50 on Matplotlib would put its scale into the page as an image."""
_MOST_SEEDS = 60
"""Columns beyond which a cell would be too small to point at."""


def worst_table(results: Results, candidate: Candidate) -> str:
    """The ten episodes to look at first."""
    metric = results.metrics[0]
    title = metric.name.replace("_", " ")
    rows = [
        [
            text(pair.candidate.case),
            text(pair.candidate.seed),
            text(quantity(pair.value(metric), metric.unit)),
            text(quantity(pair.baseline.metrics.get(metric.name) if pair.baseline else None, metric.unit)),
            text(quantity(pair.change(metric), metric.unit, signed=True)),
            text(f"{pair.candidate.duration:.2f} s"),
            text(pair.candidate.failure or "-"),
            text("-" if pair.baseline is None else pair.baseline.failure or "-"),
        ]
        for pair in worst(pair_up(candidate.run, results.baseline), metric, _WORST)
    ]
    head = ("case", "seed", title, "baseline's", "change", "lasted", "failure", "baseline's failure")
    if results.baseline is None:
        keep = (0, 1, 2, 5, 6)
        return table([head[i] for i in keep], [[row[i] for i in keep] for row in rows], numbers=(1, 2, 3))
    return table(head, rows, numbers=(1, 2, 3, 4, 5))


def episode_map(results: Results, candidate: Candidate, name: str) -> str:
    """SVG: one cell per episode, coloured by how much worse the first metric became; a cross where it failed.

    '' where there is no baseline of the same seeds, or there are too many seeds to show.

    Args:
        results: of the run.
        candidate: whose episodes are shown.
        name: unique in the page.
    """
    metric, cases, seeds = results.metrics[0], results.suite.cases, results.suite.seeds
    pairs = pair_up(candidate.run, results.baseline)
    if not any(pair.baseline for pair in pairs) or len(seeds) > _MOST_SEEDS:
        return ""
    factor, unit = displayed_unit(metric.unit)
    cells = np.full((len(cases), len(seeds)), np.nan)
    crosses, rings = [], []
    for pair in pairs:
        row, column = cases.index(pair.candidate.case), seeds.index(pair.candidate.seed)
        worsening = pair.worsening(metric)
        if worsening is not None:
            cells[row, column] = factor * worsening
        if pair.candidate.failure:
            crosses.append((column, row))
        if pair.baseline is not None and pair.baseline.failure:
            rings.append((column, row))
    known = np.abs(cells[np.isfinite(cells)])
    reach = float(known.max()) if known.size and known.max() > 0.0 else 1.0
    colours = LinearSegmentedColormap.from_list(
        "change", [COLOURS["better"], COLOURS["grid"], COLOURS["worse"]], _SHADES
    )
    height = 0.9 + 0.30 * len(cases)
    with drawing(height, name, f"change of {metric.name} in every episode") as sheet:
        axes = sheet.figure.subplots()
        edges = np.arange(len(seeds) + 1) - 0.5, np.arange(len(cases) + 1) - 0.5
        mesh = axes.pcolormesh(*edges, cells, cmap=colours, vmin=-reach, vmax=reach)
        mesh.set(edgecolor=COLOURS["paper"], linewidth=1.5)
        for points, mark, size, what in ((crosses, "x", 6, "failed"), (rings, "o", 9, "the baseline's failed")):
            if points:
                x, y = zip(*points, strict=True)
                axes.plot(x, y, mark, markersize=size, color=COLOURS["ink"], fillstyle="none", label=what)
        if crosses or rings:
            sheet.figure.legend(loc="outside upper right", ncols=2)
        axes.set_yticks(range(len(cases)), list(cases))
        axes.set_xticks(range(len(seeds)), [str(seed) for seed in seeds])
        axes.invert_yaxis()
        axes.set_xlabel("seed")
        axes.grid(visible=False)
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
        bar = sheet.figure.colorbar(mesh, ax=axes, pad=0.01, aspect=12)
        bar.set_label(f"worse by [{unit}]")
        bar.outline.set_visible(False)
        axes.set_title(f"change of {axis_label(metric.name, metric.unit).partition(' [')[0]}")
    return sheet.svg
