"""The three pictures of the page: what changed in which case, the traces of an episode, and the margins.

Matplotlib draws them as SVG inside the page: no display, no global state, the same bytes every time, light and dark.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from humanoid_sim.mit import FloatArray
from humanoid_sim.regress.report.pairs import Pair, by_case, finite_rms, metric_values, pair_up, trace, trace_difference
from humanoid_sim.regress.results import Episode, Margin, MetricInfo, PolicyRun, Results, Verdict, displayed_unit

COLOURS: Mapping[str, tuple[str, str]] = {
    "ink": ("#1c2733", "#e3e8ed"),
    "faint": ("#66727f", "#98a4b0"),
    "grid": ("#dfe4e9", "#313b46"),
    "paper": ("#ffffff", "#12181e"),
    "baseline": ("#7c8a99", "#8f9dab"),
    "candidate1": ("#2563b8", "#6ea8f5"),
    "candidate2": ("#b8650f", "#eda350"),
    "candidate3": ("#7a3fb0", "#bd90ea"),
    "candidate4": ("#0f7f7a", "#4fc3bd"),
    "worse": ("#c42f3d", "#f0707b"),
    "better": ("#1e8a4f", "#58c98a"),
    "unclear": ("#a87800", "#e0b34a"),
}
"""Colours by meaning, in light and in dark. Colour-blind readers can tell worse from better, and candidates apart."""

LIGHT: Mapping[str, str] = {meaning: light for meaning, (light, _) in COLOURS.items()}
"""Colours that plots are drawn in; on the page these colours become variables."""

_COLUMNS = 3
_CANDIDATES = 4
_WIDTH = 11.1
"""Inches of 72 points: the page's column."""
_DPI = 72.0
"""Resolution of SVG output: one figure inch is 72 points."""

SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: small, sharp, and found by the browser's search
    "svg.hashsalt": "humanoid_sim",  # names of clip paths, random otherwise
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with Matplotlib: the layout does not depend on the machine's fonts
    "font.size": 9.0,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "axes.edgecolor": LIGHT["grid"],
    "axes.labelcolor": LIGHT["faint"],
    "axes.titlecolor": LIGHT["ink"],
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "text.color": LIGHT["ink"],
    "xtick.labelcolor": LIGHT["faint"],
    "ytick.labelcolor": LIGHT["faint"],
    "grid.color": LIGHT["grid"],
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}
"""Settings of Matplotlib while a figure is made, drawn on and written."""
_SPREAD = 0.618033988749895
"""Multiples of it, less their whole part, spread evenly over an interval however many there are."""
_LONGEST_NAME = 30
_MOVED = get_args(Verdict)[1:-2]
"""Verdicts on metrics that moved, the most urgent first."""


def moved_metrics(results: Results) -> list[MetricInfo]:
    """Those that are not the same for some candidate, the most urgent first; without a baseline all that vary."""
    if results.baseline is None:
        episodes = [episode for candidate in results.candidates for episode in candidate.run.episodes]
        return [
            metric for metric in results.metrics if len({e.metrics.get(metric.name) for e in episodes} - {None}) > 1
        ]
    verdicts: dict[str, set[str]] = {}
    for candidate in results.candidates:
        for comparison in candidate.comparisons:
            verdicts.setdefault(comparison.metric, set()).add(comparison.verdict)
    moved = {name: [i for i, verdict in enumerate(_MOVED) if verdict in found] for name, found in verdicts.items()}
    names = sorted((name for name in moved if moved[name]), key=lambda name: moved[name][0])
    return [results.metric(name) for name in names]


def case_plot(results: Results, metrics: Sequence[MetricInfo], *, paired: bool, name: str) -> str:
    """Return a panel for each metric with a row for each case: a dot per episode, a tick at the mean.

    Args:
        paired: show candidate less baseline, seed by seed, and what is worse than tolerated; else all policies' values.
    """
    cases = results.suite.cases
    shown = _policies(results)[1 if paired else 0 :]
    figure, places = _panels(len(metrics), 0.7 + 0.30 * len(cases), header=0.35)
    for number, (axes, metric) in enumerate(zip(places, metrics, strict=True)):
        factor, unit = displayed_unit(metric.unit)
        for i, (run, colour) in enumerate(shown):
            values = metric_values(run.episodes, metric.name)
            if paired:
                values = by_case((pair.candidate.case, pair.change(metric)) for pair in pair_up(run, results.baseline))
            for place, case in enumerate(cases):
                y = -place + 0.35 - 0.7 * (i + 0.5) / len(shown)
                _draw_row(axes, factor * values.get(case, np.empty(0)), y, 0.7 / len(shown), colour, metric)
        if paired:
            _shade_worse(axes, results, metric)
        names = [_short(case) for case in cases] if number % _COLUMNS == 0 else []
        axes.set_yticks([-place for place in range(len(names))], names)
        axes.set_ylim(0.5 - len(cases), 0.5)
        title = metric.name.replace("_", " ")
        axes.set_title(f"change of {title} [{unit}]" if paired else f"{title} [{unit}]")
        _style_axes(axes, grid="x")
    if len(shown) > 1:
        _name_policies(figure, shown)
    return _svg_of(figure, name, "the metrics that moved, by case")


def _policies(results: Results) -> list[tuple[PolicyRun, str]]:
    """Every policy with its colour; the baseline first, if there is one."""
    candidates = [(candidate.run, candidate_colour(i)) for i, candidate in enumerate(results.candidates)]
    return candidates if results.baseline is None else [(results.baseline, LIGHT["baseline"]), *candidates]


def _name_policies(figure: Figure, policies: Sequence[tuple[PolicyRun, str]]) -> None:
    lines = [Line2D([], [], color=colour, label=_short(run.name)) for run, colour in policies]
    figure.legend(handles=lines, loc="outside upper right", ncols=len(lines))


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 1]}…"


def _shade_worse(axes: Axes, results: Results, metric: MetricInfo) -> None:
    """Draw the line of no change, and shade the side that is worse than the suite tolerates."""
    axes.axvline(0.0, color=LIGHT["faint"], linewidth=0.8)
    tolerances = [
        comparison.tolerance
        for candidate in results.candidates
        for comparison in candidate.comparisons
        if comparison.metric == metric.name and comparison.tolerance is not None
    ]
    if tolerances:
        sign = 1.0 if metric.better == "lower" else -1.0
        edge = sign * displayed_unit(metric.unit)[0] * min(tolerances)
        low, high = axes.get_xlim()
        low, high = min(low, 1.4 * edge, -0.4 * edge), max(high, 1.4 * edge, -0.4 * edge)
        axes.axvspan(edge, high if sign > 0.0 else low, color=LIGHT["worse"], alpha=0.10, linewidth=0)
        axes.set_xlim(low, high)


def _draw_row(axes: Axes, values: FloatArray, y: float, height: float, colour: str, metric: MetricInfo) -> None:
    """Draw a dot per episode and a tick at their mean; of a share the mean alone says all."""
    if not values.size:
        return
    mean = values.mean()
    axes.plot([mean, mean], [y - 0.4 * height, y + 0.4 * height], color=colour, linewidth=2.2)
    if metric.unit != "share":
        offsets = np.mod(np.arange(1, values.size + 1) * _SPREAD, 1.0) - 0.5  # no chance: the same page every time
        axes.scatter(values, y + 0.5 * height * offsets, s=9, c=colour, alpha=0.55, linewidths=0)


def trace_plot(results: Results, pair: Pair, colour: str, name: str) -> str:
    """Return the traces of an episode that differ most from the baseline's, beside those; '' where none differs."""
    names = list(pair.candidate.traces)
    if pair.baseline is not None:
        known = {name: finite_rms(trace(pair.baseline, name)) for name in names if name in pair.baseline.traces}
        sizes = {name: trace_difference(pair, name) / (known.get(name) or 1.0) for name in names}
        largest = sorted(sizes, key=lambda name: -sizes[name])[:_COLUMNS]
        names = [name for name in names if name in largest and sizes[name] > 0.0]
    names = names[:_COLUMNS]
    if not names:
        return ""
    others = [e for e in (results.baseline.episodes if results.baseline else ()) if e.case == pair.candidate.case]
    figure, places = _panels(len(names), 2.4)
    for axes, trace_name in zip(places, names, strict=True):
        unit = next((metric.unit for metric in results.metrics if metric.name == trace_name), "")
        factor, shown = displayed_unit(unit)
        _draw_range(axes, others, trace_name, factor)
        for episode, line in ((pair.baseline, LIGHT["baseline"]), (pair.candidate, colour)):
            if episode is not None and trace_name in episode.traces:
                _draw_trace(axes, episode, factor * trace(episode, trace_name), line)
        axes.set_title(trace_name.replace("_", " ") + (f" [{shown}]" if unit else ""))
        axes.set_xlabel("time [s]")
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        _style_axes(axes)
    return _svg_of(figure, name, f"traces of {pair.candidate.label}")


def _draw_trace(axes: Axes, episode: Episode, values: FloatArray, colour: str) -> None:
    """Draw a line; a cross where the episode failed."""
    axes.plot(episode.trace_times, values, color=colour)
    known = np.flatnonzero(np.isfinite(values))
    if episode.failure and known.size:
        axes.plot(episode.trace_times[known[-1]], values[known[-1]], marker="X", markersize=7, color=colour)


def _draw_range(axes: Axes, episodes: Sequence[Episode], name: str, factor: float) -> None:
    """Between the least and the greatest of the baseline's episodes of the same case, at each time."""
    known = [e for e in episodes if name in e.traces and len(e.trace_times) > 1]
    if not known:
        return
    times = np.array(max(known, key=lambda e: e.trace_times[-1]).trace_times)
    rows = [np.interp(times, e.trace_times, factor * trace(e, name), right=np.nan) for e in known]
    stacked = np.ma.masked_invalid(np.stack(rows))
    low, high = stacked.min(axis=0).filled(np.nan), stacked.max(axis=0).filled(np.nan)
    axes.fill_between(times, low, high, color=LIGHT["baseline"], alpha=0.16, linewidth=0)


def margin_plot(results: Results, name: str) -> str:
    """Draw a panel for each disturbance: the share of episodes that fail as it is raised; '' without margins."""
    policies = _policies(results)
    disturbances = list(dict.fromkeys(margin.axis for run, _ in policies for margin in run.margins))
    if not disturbances:
        return ""
    figure, places = _panels(len(disturbances), 1.75, header=0.4)
    for axes, disturbance in zip(places, disturbances, strict=True):
        for run, colour in policies:
            for margin in run.margins:
                if margin.axis == disturbance:
                    _draw_margin(axes, margin, colour, 4.0 if run is results.baseline else 1.4)
        axes.set_ylabel("failed [%]")
        axes.set_ylim(-5.0, 105.0)
        _style_axes(axes)
    _name_policies(figure, policies)
    return _svg_of(figure, name, "share of failed episodes over each disturbance")


def _draw_margin(axes: Axes, margin: Margin, colour: str, width: float) -> None:
    factor, unit = displayed_unit(margin.unit)
    levels = factor * np.array([margin.nominal, *margin.levels])
    shares = 100.0 * np.array([0.0, *margin.failed_share])
    axes.plot(levels[: len(shares)], shares, color=colour, linewidth=width, marker="o", markersize=3.5)
    axes.axvline(factor * margin.limit, color=colour, linewidth=0.7 * width, dashes=(3, 2))
    axes.set_title(f"{margin.axis.replace('_', ' ')} [{unit}]")


def candidate_colour(index: int) -> str:
    """Return the colour of the candidate at `index`; the fifth has the first one's again."""
    return LIGHT[f"candidate{index % _CANDIDATES + 1}"]


def _panels(count: int, height: float, header: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` places for plots, `_COLUMNS` in a row at most.

    A row is `height` inches of 72 points high; `header` is the room above the first one.
    """
    rows = -(-count // _COLUMNS)
    figure = Figure(figsize=(_WIDTH, header + rows * height), layout="constrained")
    FigureCanvasSVG(figure)
    grid = list(figure.subplots(rows, min(count, _COLUMNS), squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def _style_axes(axes: Axes, *, grid: Literal["both", "x"] = "both") -> None:
    """Ticks without marks, and a grid along x alone where y counts nothing."""
    axes.tick_params(length=0)
    axes.grid(visible=True, axis=grid)


def _svg_of(figure: Figure, name: str, description: str) -> str:
    """Return the `svg` element of a figure drawn under `SETTINGS`, its colours those of the page in light and dark.

    `name` is unique in the page: what the SVG defines must not be confused with another's. The description is for
    readers who cannot see it.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    opening, body = svg[svg.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="[^"]*"', opening)
    assert box is not None
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = body.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
    for meaning, colour in LIGHT.items():
        body = body.replace(colour, f"var(--{meaning})")
    return f'<svg {box.group()} role="img" aria-label="{escape(description)}">{body.strip()}'
