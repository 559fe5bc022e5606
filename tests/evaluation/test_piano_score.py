"""Scores of performances that can be counted by hand."""

import numpy as np
import pytest

from humanoid_sim.evaluation.piano_score import Ratio, score


def keys(*rows):
    """One text for each key, one character for each step."""
    return np.array([[letter == "#" for letter in row] for row in rows], dtype=np.float32).T


def test_a_perfect_performance():
    song = keys("##..##..", "....#...")
    result = score(song, song, 0.05)
    assert (result.steps, result.notes) == (Ratio(1.0, 1.0, 1.0), Ratio(1.0, 1.0, 1.0))
    assert (result.note_count, result.hit_count, result.false_count) == (3, 3, 0)


def test_steps_are_scored_one_by_one_and_a_rest_is_right():
    wanted = keys("##..", "##..")
    pressed = keys("#..#", "##..")
    result = score(pressed, wanted, 0.05)
    # precision 1, 1, (0/0 =) 1, 0; recall 1, 1/2, 1, (0/0 =) 1; F1 1, 2/3, 1, 0
    assert result.steps == Ratio(0.75, 0.875, pytest.approx((1 + 2 / 3 + 1) / 4))


def test_strokes_match_notes_of_their_key_in_time():
    wanted = keys("#...#...#...", "............")
    early, late, wrong = keys("#....#......", "........#..."), 0.05, 0.049
    assert score(early, wanted, 0.05, onset_tolerance=late).hit_count == 2
    strict = score(early, wanted, 0.05, onset_tolerance=0.02)
    assert (strict.hit_count, strict.false_count, strict.note_count) == (1, 2, 3)
    assert strict.notes == Ratio(pytest.approx(1 / 3), pytest.approx(1 / 3), pytest.approx(1 / 3))
    assert wrong < late


def test_one_stroke_plays_one_note():
    result = score(keys("###"), keys("#.#"), 0.05, onset_tolerance=0.2)
    assert (result.hit_count, result.note_count) == (1, 2)
