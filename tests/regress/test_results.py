"""Numbers of the results as a person reads them."""

import math

import msgspec
import pytest

from humanoid_sim.regress import results
from humanoid_sim.regress.metrics import METRICS


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
def test_quantities(value, unit, text):
    assert results.quantity(value, unit) == text


def test_changes_have_a_sign():
    assert results.quantity(0.001, "m", signed=True) == "+1 mm"


def announced(metric, baseline, change):
    return results.describe_detectable(METRICS["tracking"][metric].info, change, baseline)


def test_what_a_suite_finds():
    assert announced("body_position_error", 0.004, 0.0003) == "+0.3 mm (7.5 %)"
    assert announced("survival", 0.8, 0.2) == "-20 % (25.0 %)"
    assert announced("faults", 0.0, 0.11) == "+11 %"
    assert announced("faults", 0.0, 1.06) == "too few episodes"
    assert announced("faults", 0.0, None) == "-"


def test_what_makes_a_metric_worse_whatever_its_mean():
    case = results.CaseComparison(
        case="wave",
        verdict="worse beyond tolerance",
        baseline=2.0,
        candidate=2.4,
        change=0.4,
        low=0.3,
        high=0.5,
        tolerance=0.1,
    )
    same = msgspec.structs.replace(case, case="drum", verdict="no difference seen")
    comparison = results.Comparison(
        metric="joint_error",
        verdict="worse beyond tolerance",
        baseline=2.0,
        candidate=2.1,
        change=0.1,
        low=0.0,
        high=0.2,
        tolerance=0.1,
        episodes=8,
        paired=True,
        cases=(case, same),
    )
    assert comparison.reasons == "in wave by +20.0 %"
    assert msgspec.structs.replace(comparison, cases=(case, case)).reasons == ""  # the mean says it already
    failed = msgspec.structs.replace(comparison, cases=(), new_failures=tuple(f"wave, seed {i}" for i in range(5)))
    assert failed.reasons == "5 new: wave, seed 0; wave, seed 1; wave, seed 2 and 2 more"


def test_how_far_a_margin_reaches():
    margin = results.Margin(
        axis="gains down",
        unit="×",
        nominal=1.0,
        limit=0.5,
        reached_end=False,
        levels=(0.8, 0.5, 0.45, 0.4),
        failed_share=(0.0, 0.0, 0.5, 1.0),
    )
    assert margin.fails_at == 0.45
    assert margin.words == "0.5×"
    end = msgspec.structs.replace(margin, reached_end=True)
    assert end.fails_at is None
    assert end.words == "≥ 0.5×"
