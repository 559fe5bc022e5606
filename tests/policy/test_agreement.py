"""When two sources say the same: rounded copies, and what is too far off to be one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.policy.readers.merge import agreed, contradiction
from humanoid_sim.policy.readers.partial import Given


def rounded(values, decimals):
    return Given(np.round(values, decimals), "coarse", decimals)


@given(st.lists(st.floats(-200.0, 200.0), min_size=1, max_size=5).map(np.array), st.integers(3, 6))
def test_a_rounded_copy_agrees_and_the_precise_one_wins(values, decimals):
    fine = Given(values, "fine")
    for pair in ((fine, rounded(values, decimals)), (rounded(values, decimals), fine)):
        both = agreed("joint_stiffness", *pair)
        np.testing.assert_allclose(both.value, values, rtol=1e-9)
        if not np.allclose(values, np.round(values, decimals), rtol=1e-9, atol=0.0):
            assert both.source == "fine (coarse has it rounded)"


@given(st.lists(st.floats(1.0, 200.0), min_size=1, max_size=5).map(np.array), st.sampled_from([0.6, 1.0, 3.0]))
def test_what_is_off_by_more_than_rounding_contradicts(values, steps):
    values = np.round(values, 3)
    # With fewer decimals the other one could itself be a rounded copy: 64.09 of 64.089.
    assert agreed("joint_stiffness", Given(values, "a", 3), Given(values + 1e-3 * steps, "b", 4)) is None


@pytest.mark.parametrize(
    ("coarse", "fine", "agree"),
    [
        (40.2, 40.179238471, True),
        (2.6, 2.557889765, True),
        (0.55, 0.547546, True),
        (0.35, 0.548, False),
        (0.2, 0.25, False),
        (0.3, 0.25, False),
        (1.0, 1.04, False),
        (14.0, 14.25, False),
        (100.0, 99.098, False),
    ],
)
def test_few_digits_count_as_rounding_only_if_they_mean_something(coarse, fine, agree):
    assert (agreed("action_scale", Given(coarse, "a"), Given(fine, "b")) is not None) is agree
    assert (agreed("action_scale", Given(fine, "b"), Given(coarse, "a")) is not None) is agree


def test_names_in_another_number_are_told_apart():
    first, second = Given(("hip", "knee", "knee"), "a"), Given(("knee", "hip"), "b")
    assert contradiction("body_names", first, second).startswith("body_names: knee only in a; if one of them is wrong")


def test_a_number_and_nothing_contradict_each_other():
    text = contradiction("phase.standing_value", Given(None, "a"), Given(3.0, "b"))
    assert text.startswith("phase.standing_value: none in a contradicts 3 in b; ")
