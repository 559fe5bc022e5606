"""Scores of performances that can be counted by hand."""

import numpy as np
import pytest

from humanoid_sim.errors import FieldError
from humanoid_sim.evaluation.piano_score import PlayedKeys


def keys(*rows):
    """One text for each key, one character for each step."""
    return np.array([[letter == "#" for letter in row] for row in rows], dtype=np.float32).T


def score(pressed, wanted):
    played = PlayedKeys(wanted)
    for frame, row in enumerate(pressed):
        played.update(frame, row)
    return tuple(played.score().values())


def test_a_perfect_performance():
    song = keys("##..##..", "....#...")
    assert score(song, song) == (1.0, 1.0, 1.0)


def test_steps_are_scored_one_by_one_and_a_rest_is_right():
    # precision 1, 1, (0/0 =) 1, 0; recall 1, 1/2, 1, (0/0 =) 1; F1 1, 2/3, 1, 0
    expected = (0.75, 0.875, pytest.approx((1 + 2 / 3 + 1) / 4))
    assert score(keys("#..#", "##.."), keys("##..", "##..")) == expected


def test_each_frame_counts_once_and_only_those_that_were_shown():
    played = PlayedKeys(keys("##.."))
    assert played.score() is None
    for frame, pressed in ((1, 0.0), (1, 1.0), (4, 1.0)):
        played.update(frame, np.array([pressed]))
    assert played.score() == {"precision": 1.0, "recall": 0.0, "f1": 0.0}
    with pytest.raises(FieldError, match="has 2 keys, and the song 1"):
        played.update(0, np.zeros(2))
