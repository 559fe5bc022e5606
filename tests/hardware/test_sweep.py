from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.sweep import Sweep, SweepResult, Verdict, evaluate
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import JointDescription

_LITE = load_robot("lite")
_ELBOW = _LITE.joints[3]  # -2.35619 to 0
_YAW = _LITE.joints[2]  # ±1.5708


def _swept(joint: JointDescription, direction: int, offset: float, turns: int = 0) -> Sweep:
    """A sweep of the whole range of a joint whose motor has this offset and counts these turns too many."""
    sweep = Sweep()
    for angle in (0.5 * (joint.lower + joint.upper), joint.lower, joint.upper):
        motor = direction * angle + offset + 2.0 * math.pi * turns
        sweep = sweep.with_angle(direction * motor)
    return sweep


def _verdict(joint: JointDescription, direction: int, sweep: Sweep, any_offset: bool = False) -> SweepResult:
    return evaluate(joint, direction, sweep, threshold=0.5, tolerance=0.2, any_offset=any_offset)


@given(st.sampled_from(_LITE.joints), st.sampled_from((-1, 1)), st.floats(-0.5, 0.5), st.integers(-2, 2))
def test_a_sweep_from_stop_to_stop_gives_the_offset_on_any_turn(
    joint: JointDescription, direction: int, offset: float, turns: int
) -> None:
    result = _verdict(joint, direction, _swept(joint, direction, offset, turns))
    assert result.verdict is Verdict.GOOD
    assert result.homing_offset == pytest.approx(offset, abs=1e-9)
    assert result.width == pytest.approx(joint.upper - joint.lower)


@given(st.floats(-math.pi, math.pi))
def test_motors_assembled_anywhere_are_calibrated_when_that_is_said(offset: float) -> None:
    result = _verdict(_ELBOW, 1, _swept(_ELBOW, 1, offset), any_offset=True)
    assert result.homing_offset is not None
    assert math.cos(result.homing_offset - offset) == pytest.approx(1.0)


def test_a_flipped_direction_is_found_where_the_joint_cannot_be() -> None:
    flipped = Sweep().with_angle(0.02).with_angle(2.36)  # the elbow bends the other way
    result = _verdict(_ELBOW, -1, flipped)
    assert (result.verdict, result.homing_offset) == (Verdict.FLIPPED, None)
    assert result.width == pytest.approx(2.34)


def test_a_short_sweep_within_the_limits_is_not_flipped() -> None:
    result = evaluate(_ELBOW, -1, Sweep(-0.12, -0.1), threshold=0.0, tolerance=0.2, any_offset=False)
    assert result.verdict is Verdict.INCOMPLETE


def test_a_symmetric_joint_does_not_show_its_direction() -> None:
    flipped = Sweep().with_angle(-1.5708).with_angle(1.5708)
    assert _verdict(_YAW, -1, flipped).verdict is Verdict.GOOD


def test_a_joint_that_was_not_moved_is_not_swept() -> None:
    assert _verdict(_YAW, 1, Sweep()) == SweepResult(Verdict.UNSWEPT, 0.0, None)
    assert _verdict(_YAW, 1, Sweep(0.1, 0.59)).verdict is Verdict.UNSWEPT


@pytest.mark.parametrize(
    ("upper", "verdict"), [(1.2, Verdict.INCOMPLETE), (1.9, Verdict.BEYOND), (9.0, Verdict.BEYOND)]
)
def test_a_sweep_that_is_not_the_joints_range_gives_no_offset(upper: float, verdict: Verdict) -> None:
    result = _verdict(_YAW, 1, Sweep(-1.5708, upper))
    assert (result.verdict, result.homing_offset) == (verdict, None)


def test_the_formula_of_the_reference() -> None:
    joint, sweep = _LITE.joints[0], Sweep(-3.0, 1.0)
    assert _verdict(joint, -1, sweep).homing_offset == pytest.approx(
        -0.5 * ((-3.0 - joint.lower) + (1.0 - joint.upper))
    )


def test_angles_that_are_none_change_nothing() -> None:
    assert Sweep(1.0, 2.0).with_angle(math.nan) == Sweep(1.0, 2.0)
    assert Sweep().with_angle(0.5).with_angle(math.inf) == Sweep(0.5, 0.5)
