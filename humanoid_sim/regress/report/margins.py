"""How much each policy bears: the share of episodes that fail as a disturbance is raised."""

from __future__ import annotations

from matplotlib.axes import Axes

from humanoid_sim.regress.report.drawing import drawing, style_axes
from humanoid_sim.regress.report.markup import badge, table, text
from humanoid_sim.regress.report.palette import COLOURS, candidate_colour
from humanoid_sim.regress.results import Candidate, Margin, Results
from humanoid_sim.regress.words import displayed_unit, quantity

__all__ = ["margin_plot", "margin_table"]

_COLUMNS = 3


def margin_table(candidate: Candidate, results: Results) -> str:
    """Each margin beside the baseline's, and what failed beyond it."""
    before = {margin.axis: margin for margin in results.baseline.margins} if results.baseline else {}
    verdicts = {comparison.axis: comparison.verdict for comparison in candidate.margins}
    rows = []
    for margin in candidate.run.margins:
        other = before.get(margin.axis)
        verdict = verdicts.get(margin.axis)
        rows.append(
            [
                text(margin.axis),
                text(_limit(other)) if other else "-",
                text(_limit(margin)),
                badge(verdict) if verdict else "-",
                text(margin.failure or "-"),
            ]
        )
    return table(("disturbance", "baseline bears", "candidate bears", "verdict", "fails beyond it with"), rows)


def _limit(margin: Margin) -> str:
    return f"{'≥ ' if margin.reached_end else ''}{quantity(margin.limit, margin.unit)}"


def margin_plot(results: Results, name: str) -> str:
    """SVG: one small plot per disturbance with a line per policy; '' where no margins were measured.

    Args:
        results: of the run.
        name: unique in the page.
    """
    runs = [(c.run, candidate_colour(i)) for i, c in enumerate(results.candidates)]
    if results.baseline is not None:
        runs.insert(0, (results.baseline, COLOURS["baseline"]))
    disturbances = list(dict.fromkeys(margin.axis for run, _ in runs for margin in run.margins))
    if not disturbances:
        return ""
    rows = -(-len(disturbances) // _COLUMNS)
    with drawing(0.4 + 1.75 * rows, name, "share of failed episodes over each disturbance") as sheet:
        grid = list(sheet.figure.subplots(rows, _COLUMNS, squeeze=False, sharey=True).flat)
        for axes, disturbance in zip(grid, disturbances, strict=False):
            for run, colour in runs:
                for margin in run.margins:
                    if margin.axis == disturbance:
                        _draw(axes, margin, colour, run.name if axes is grid[0] else "")
            style_axes(axes)
        for axes in grid[::_COLUMNS]:
            axes.set_ylabel("failed [%]")
        for axes in grid[len(disturbances) :]:
            axes.set_visible(False)
        sheet.figure.legend(loc="outside upper right", ncols=len(runs))
    return sheet.svg


def _draw(axes: Axes, margin: Margin, colour: str, label: str) -> None:
    factor, unit = displayed_unit(margin.unit)
    shares = [100.0 * share for share in margin.failed_share]
    levels = [factor * level for level in margin.levels[: len(shares)]]
    axes.plot(
        [factor * margin.nominal, *levels],
        [0.0, *shares],
        color=colour,
        marker="o",
        markersize=3.5,
        label=label or "_",  # an underscore keeps it out of the legend
    )
    axes.axvline(factor * margin.limit, color=colour, linewidth=1.0, dashes=(3, 2))
    axes.set_title(f"{margin.axis.replace('_', ' ')} [{unit}]")
    axes.set_ylim(-5.0, 105.0)
