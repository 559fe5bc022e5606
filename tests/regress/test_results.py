"""Numbers of the results as a person reads them."""

from __future__ import annotations

import math

import pytest

from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.results import Detectable, describe_detectable, quantity


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0123, "m", "12.3 mm"),
        (math.pi / 2, "rad", "90°"),
        (math.pi, "rad/s", "180 °/s"),
        (0.02, "s", "20 ms"),
        (0.25, "share", "25 %"),
        (1.5, "×", "1.5×"),
        (12.0, "N·m", "12 N·m"),
        (None, "m", "-"),
        (math.nan, "m", "-"),
    ],
)
def test_quantities(value: float | None, unit: str, text: str) -> None:
    assert quantity(value, unit) == text


def test_changes_have_a_sign() -> None:
    assert quantity(0.001, "m", signed=True) == "+1 mm"


def announced(metric: str, baseline: float, change: float) -> str:
    info = METRICS["tracking"][metric].info
    return describe_detectable(
        info, Detectable(metric=metric, baseline=baseline, tolerance=0.0, change=change, power=0.8)
    )


def test_what_a_suite_finds() -> None:
    assert announced("body_position_error", 0.004, 0.0003) == "+0.3 mm (7.5 %)"
    assert announced("survival", 0.8, 0.2) == "-20 % (25.0 %)"
    assert announced("faults", 0.0, 0.11) == "+11 %"
    assert announced("faults", 0.0, 1.06) == "too few episodes"
