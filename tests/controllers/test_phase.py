"""The gait clock: how it walks, wraps and stands."""

from __future__ import annotations

import numpy as np
import pytest

from humanoid_sim.controllers.phase import PhaseRule, advance_phase
from humanoid_sim.errors import FieldError

WALK, STAND = np.array([0.5, 0.0, 0.0]), np.zeros(3)
STEP = 2.0 * np.pi * 0.02


def phases(rule: PhaseRule, commands: list[np.ndarray]) -> list[list[float]]:
    walked, shown = 0.0, []
    for command in commands:
        walked, phase = advance_phase(rule, walked, command, 0.02)
        shown.append(phase.tolist())
    return shown


def test_the_clock_advances_before_or_after_it_is_seen():
    first = phases(PhaseRule(1.0, [0.0]), [WALK, WALK])
    after = phases(PhaseRule(1.0, [0.0], advance_first=False), [WALK, WALK])
    np.testing.assert_allclose(first, [[STEP], [2 * STEP]])
    np.testing.assert_allclose(after, [[0.0], [STEP]])


def test_phases_stay_within_a_turn_and_come_round():
    shown = np.array(phases(PhaseRule(1.0), [WALK] * 120))
    assert (shown >= -np.pi).all()
    assert (shown < np.pi).all()
    np.testing.assert_allclose(shown[50], shown[0], atol=1e-9)
    np.testing.assert_allclose(np.cos(shown[:, 0]), -np.cos(shown[:, 1]), atol=1e-9)


def test_standing_shows_its_value_and_walking_on_starts_again():
    rule = PhaseRule(1.0, [0.0], standing_threshold=0.1)
    np.testing.assert_allclose(phases(rule, [WALK, STAND, WALK]), [[STEP], [np.pi], [STEP]])


def test_a_clock_may_run_on_while_the_robot_stands():
    rule = PhaseRule(1.0, [0.0], standing_threshold=0.1, standing_restarts=False)
    np.testing.assert_allclose(phases(rule, [WALK, STAND, WALK]), [[STEP], [np.pi], [3 * STEP]])


def test_standing_may_have_no_phase():
    rule = PhaseRule(1.0, [0.0], standing_threshold=0.1, standing_value=None)
    assert np.isnan(phases(rule, [STAND])).all()


def test_a_batch_is_its_robots_one_by_one():
    rule = PhaseRule(0.8, standing_threshold=0.1)
    commands, walked = np.stack([WALK, STAND]), np.array([1.0, 2.0])
    moved, shown = advance_phase(rule, walked, commands, 0.02)
    for i in range(2):
        one_moved, one_shown = advance_phase(rule, walked[i], commands[i], 0.02)
        assert moved[i].tobytes() == np.asarray(one_moved).tobytes()
        assert shown[i].tobytes() == one_shown.tobytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"period": 0.0}, "period: is 0.0, expected a finite number > 0"),
        ({"offsets": []}, r"offsets: is \[\], expected one finite angle per foot"),
        ({"offsets": [np.nan]}, r"offsets: is \[nan\], expected one finite angle per foot"),
        ({"standing_threshold": -1.0}, "standing_threshold: is -1.0"),
        ({"standing_value": np.inf}, "standing_value: is inf"),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(FieldError, match=f"^PhaseRule.{message}"):
        PhaseRule(**{"period": 1.0, **changes})
