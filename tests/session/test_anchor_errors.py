from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.controllers.context import ANCHOR_POSE
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.mit import Extern, MITState
from humanoid_sim.session.anchor_errors import AnchorErrors

REFERENCE = MotionReference(
    2,
    {
        "reference_joint_pos": np.array([[0.1, 0.2], [0.3, 0.4]]),
        "reference_joint_vel": np.zeros((2, 2)),
        "anchor_pos": np.array([[0.0, 0.0, 0.8], [1.0, 0.0, 0.8]]),
        "anchor_quat": np.array([[1.0, 0.0, 0.0, 0.0]] * 2),
    },
)


def state(joints: list[float], position: list[float], yaw: float) -> MITState:
    pose = np.array([*position, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    return replace(MITState.unknown(2), joint_position=np.array(joints), extern={ANCHOR_POSE: Extern(pose, 0.0)})


def test_the_reference_is_laid_onto_the_robot() -> None:
    errors = AnchorErrors(REFERENCE, ("b", "a"), ("a", "b"), align=True)
    errors.update(0, state([0.2, 0.1], [3.0, -1.0, 0.8], math.pi / 2))
    errors.update(1, state([0.4, 0.3], [3.0, 0.0, 0.8], math.pi / 2))
    summary = errors.summary()
    assert summary is not None
    assert summary.samples == 2
    for figure in (summary.joint_error, summary.anchor_position, summary.anchor_angle):
        assert figure == pytest.approx((0.0, 0.0), abs=1e-6)


def test_mean_and_greatest_errors() -> None:
    errors = AnchorErrors(REFERENCE, ("a", "b"), ("a", "b"), align=False)
    errors.update(0, state([0.1, 0.2], [0.0, 0.0, 0.8], 0.0))
    errors.update(1, state([0.3, 0.8], [1.0, 0.3, 0.4], 0.6))
    summary = errors.summary()
    assert summary is not None
    assert summary.joint_error == pytest.approx((0.1, 0.2), abs=1e-6)
    assert summary.anchor_position == pytest.approx((0.25, 0.5), abs=1e-6)
    assert summary.anchor_angle == pytest.approx((0.3, 0.6), abs=1e-6)


def test_a_state_without_the_anchor_is_not_counted() -> None:
    errors = AnchorErrors(REFERENCE, ("a", "b"), ("a", "b"), align=True)
    errors.update(0, MITState.unknown(2))
    assert errors.summary() is None
