"""Numbers of a comparison as a person reads them."""

from __future__ import annotations

import math

from humanoid_sim.regress.results import Comparison, Detectable, MarginComparison, MetricInfo

__all__ = ["change_in_words", "detectable_in_words", "displayed_unit", "margin_in_words", "quantity"]


def displayed_unit(unit: str) -> tuple[float, str]:
    """What to multiply a value by, and the unit that it then has: lengths in mm, angles in degrees, shares in %."""
    return {
        "m": (1e3, "mm"),
        "rad": (180.0 / math.pi, "°"),
        "rad/s": (180.0 / math.pi, "°/s"),
        "s": (1e3, "ms"),
        "share": (100.0, "%"),
    }.get(unit, (1.0, unit))


def quantity(value: float | None, unit: str, *, signed: bool = False) -> str:
    """A value with the unit that a person reads it in, such as `12.1 mm`; `-` where there is none."""
    if value is None or math.isnan(value):
        return "-"
    factor, shown = displayed_unit(unit)
    gap = "" if shown in ("°", "×") else " "
    return f"{factor * value:{'+' if signed else ''}.3g}{gap}{shown}"


def change_in_words(metric: MetricInfo, comparison: Comparison) -> str:
    """Such as `12.1 mm, was 10.3 mm: +1.8 mm (+17.5 %), between +1.5 and +2.1 mm; tolerated: 0.515 mm`."""
    unit = metric.unit
    if comparison.change is None:
        return f"{quantity(comparison.candidate, unit)}, was {quantity(comparison.baseline, unit)}"
    relative = "" if comparison.relative is None else f" ({100.0 * comparison.relative:+.1f} %)"
    return (
        f"{quantity(comparison.candidate, unit)}, was {quantity(comparison.baseline, unit)}: "
        f"{quantity(comparison.change, unit, signed=True)}{relative}, between "
        f"{quantity(comparison.low, unit, signed=True)} and {quantity(comparison.high, unit, signed=True)}; "
        f"tolerated: {quantity(comparison.tolerance, unit)}"
    )


def detectable_in_words(metric: MetricInfo, detectable: Detectable) -> str:
    """Such as `+0.9 mm (8.7 %)`: the worsening that the suite finds."""
    if metric.unit == "share" and detectable.change > 1.0:
        return "too few episodes"  # not even if all of them failed
    sign = 1.0 if metric.better == "lower" else -1.0
    relative = f" ({100.0 * detectable.change / abs(detectable.baseline):.1f} %)" if detectable.baseline else ""
    return f"{quantity(sign * detectable.change, metric.unit, signed=True)}{relative}"


def margin_in_words(margin: MarginComparison) -> str:
    """Such as `0.02, was 0.03`."""
    return f"{margin.candidate:g}, was {margin.baseline:g}"
