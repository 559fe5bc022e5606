"""The change of a metric as a small bar: where its interval lies, beside what is tolerated."""

from __future__ import annotations

from humanoid_sim.regress.report.markup import attributes, element
from humanoid_sim.regress.results import Comparison, MetricInfo

__all__ = ["interval_bar"]

_WIDTH, _HEIGHT = 190.0, 22.0
"""CSS pixels."""
_TOLERANCES = 2.5
"""The bar shows at least this many tolerances to either side."""
_ROOM = 1.1
"""And the interval with this much room."""


def interval_bar(metric: MetricInfo, comparison: Comparison) -> str:
    """An SVG with better to the left and worse to the right, whichever way the metric counts; '' without a change."""
    change, low, high, tolerance = comparison.change, comparison.low, comparison.high, comparison.tolerance
    if change is None or low is None or high is None or tolerance is None:
        return ""
    sign = 1.0 if metric.better == "lower" else -1.0
    left, right = sorted((sign * low, sign * high))
    reach = max(_TOLERANCES * tolerance, _ROOM * abs(left), _ROOM * abs(right))
    if reach == 0.0:
        reach = 1.0  # nothing changed, and nothing may

    def x(value: float) -> float:
        return 0.5 * _WIDTH * (1.0 + value / reach)

    half = 0.5 * _HEIGHT
    colour = f"var(--{comparison.verdict if comparison.verdict in ('worse', 'better', 'unclear') else 'faint'})"
    stroke = f"stroke: {colour}; stroke-width: 2"
    parts = [
        _band(x(tolerance), _WIDTH, "fill: var(--worse); opacity: 0.08"),
        _band(x(-tolerance), x(tolerance), "fill: var(--grid)"),
        _line(x(0.0), 2.0, x(0.0), _HEIGHT - 2.0, "stroke: var(--faint); stroke-width: 1"),
        _line(x(left), half, x(right), half, stroke),
        _line(x(left), half - 4.0, x(left), half + 4.0, stroke),
        _line(x(right), half - 4.0, x(right), half + 4.0, stroke),
        element("circle", "", cx=f"{x(sign * change):.1f}", cy=f"{half}", r="4", style=f"fill: {colour}"),
    ]
    box = f'viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}"'
    label = attributes(**{"aria-label": f"change of {metric.name} with its interval, worse to the right"})
    return f'<svg class="bar" role="img" {label} {box}>{"".join(parts)}</svg>'


def _line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    return element("line", "", x1=f"{x1:.1f}", y1=f"{y1:.1f}", x2=f"{x2:.1f}", y2=f"{y2:.1f}", style=style)


def _band(start: float, end: float, style: str) -> str:
    return element("rect", "", x=f"{start:.1f}", y="0", width=f"{end - start:.1f}", height=f"{_HEIGHT}", style=style)
