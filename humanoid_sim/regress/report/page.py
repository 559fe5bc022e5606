"""What the template `page.html` shows: verdicts first, then what they come from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from jinja2 import Environment, PackageLoader, StrictUndefined

from humanoid_sim.regress.report.drawing import COLOURS, SETTINGS, candidate_colour
from humanoid_sim.regress.report.pairs import mean_over_cases, pair_up, worst
from humanoid_sim.regress.report.plots import case_plot, margin_plot, moved_metrics, trace_plot
from humanoid_sim.regress.results import (
    Candidate,
    Comparison,
    MetricInfo,
    Results,
    describe_detectable,
    describe_limit,
    quantity,
)

__all__ = ["IntervalBar", "interval_bar", "render"]

_WORST = 10
_BAR_END = 31.0
"""Tolerances at the end of an interval's bar."""


def render(results: Results) -> str:
    """The HTML of the page."""
    environment = Environment(
        loader=PackageLoader("humanoid_sim.regress.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {"quantity": quantity, "limit": describe_limit, "listed": _listed}
    comparisons = [comparison for candidate in results.candidates for comparison in candidate.comparisons]
    paired = results.baseline is not None and all(comparison.paired for comparison in comparisons)
    moved = moved_metrics(results)
    with mpl.rc_context(SETTINGS):
        pictures = {
            "cases": case_plot(results, moved, paired=paired, name="cases-plot") if moved else "",
            "candidates": [_candidate(results, i, candidate) for i, candidate in enumerate(results.candidates)],
            "margins": margin_plot(results, "margins-plot"),
        }
    return environment.get_template("page.html").render(
        **pictures,
        results=results,
        colours=COLOURS,
        paired=paired,
        old_margins={margin.axis: margin for margin in results.baseline.margins} if results.baseline else {},
        mean=mean_over_cases,
        tolerated=_TOLERATED,
        runs=[
            *([("baseline", results.baseline)] if results.baseline else []),
            *(("candidate", candidate.run) for candidate in results.candidates),
        ],
    )


def _candidate(results: Results, index: int, candidate: Candidate) -> dict[str, Any]:
    """What the page shows of one candidate beside what it holds itself."""
    first = worst(pair_up(candidate.run, results.baseline), results.metrics[0], _WORST)
    detectable = {
        item.metric: describe_detectable(results.metric(item.metric), item.change, item.baseline)
        for item in results.detectable
    }
    return {
        "run": candidate.run,
        "worse": candidate.worse,
        "rows": [
            (metric, comparison, interval_bar(metric, comparison), detectable.get(metric.name, "-"))
            for comparison in candidate.comparisons
            for metric in [results.metric(comparison.metric)]
        ],
        "worst": first,
        "traces": trace_plot(results, first[0], candidate_colour(index), f"traces-{index}-plot") if first else "",
        "margin_verdicts": {comparison.axis: comparison.verdict for comparison in candidate.margins},
    }


@dataclass(frozen=True, slots=True)
class IntervalBar:
    """Where the change of a metric and its interval lie on a bar from -100 to 100, worse to the right."""

    left: float
    change: float
    right: float


_TOLERATED = 100.0 / math.log2(1.0 + _BAR_END)
"""Where on every bar the tolerance ends."""


def interval_bar(metric: MetricInfo, comparison: Comparison) -> IntervalBar | None:
    """All bars have one scale, in tolerances: about even within them, and logarithmic beyond. None without a change."""
    change, low, high, tolerance = comparison.change, comparison.low, comparison.high, comparison.tolerance
    if change is None or low is None or high is None or tolerance is None:
        return None
    sign = 1.0 if metric.better == "lower" else -1.0

    def place(value: float) -> float:
        if value == 0.0:
            return 0.0
        tolerances = abs(value) / tolerance if tolerance else math.inf
        return math.copysign(_TOLERATED * math.log2(1.0 + min(tolerances, _BAR_END)), sign * value)

    return IntervalBar(min(place(low), place(high)), place(change), max(place(low), place(high)))


def _listed(names: tuple[str, ...]) -> str:
    """Such as `effort, slip and margin delay`."""
    readable = [name.replace("_", " ") for name in names]
    return " and ".join([", ".join(readable[:-1]), readable[-1]] if len(readable) > 1 else readable)
