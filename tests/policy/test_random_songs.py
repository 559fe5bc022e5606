"""Random songs keep to what they promise, whatever the seed."""

from itertools import pairwise

import numpy as np
import pytest

from humanoid_sim.assets import song_path
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.random_songs import APART, held_out_songs, named_song, random_song
from humanoid_sim.policy.song import LEAD_IN, Note, Song, goals
from humanoid_sim.robots.description import load_robot
from tools.samples.songs import most_onsets

HANDS = (tuple(range(20, 46)), tuple(range(38, 64)))


def test_songs_keep_within_reach_pace_and_room():
    keys = np.zeros(88, dtype=int)
    for seed in range(60):
        song = random_song(np.random.default_rng(seed), HANDS, seconds=12.0)
        assert song.notes[0].start >= LEAD_IN
        assert song.seconds <= 12.0
        assert most_onsets(song) <= 3
        for note in song.notes:
            keys[note.key] += 1
            assert note.key in HANDS[note.track]
            assert note.end - note.start > 0.119
        for voice in (0, 1):
            own = [note for note in song.notes if note.track == voice]
            assert all(a.end < b.start for a, b in pairwise(own))
        for low in (note for note in song.notes if note.track == 0):
            for high in (note for note in song.notes if note.track == 1):
                assert high.start >= low.end or low.start >= high.end or high.key - low.key >= APART
    assert (keys[20:64] > 5).all(), "every key in reach is played"
    assert keys.sum() == keys[20:64].sum() > 1000


def test_songs_differ_from_one_another_and_are_the_same_again():
    first, second = held_out_songs(HANDS, 2)
    assert first.notes != second.notes
    assert held_out_songs(HANDS, 1)[0].notes == first.notes
    assert held_out_songs(HANDS, 1, seed=1)[0].notes != first.notes
    assert random_song(np.random.default_rng(0), HANDS).notes != first.notes
    assert np.abs(goals(first, 0.02).sum(axis=1)).max() <= 2


def test_onsets_are_counted_within_a_second():
    notes = tuple(Note(30, start, start + 0.1) for start in (0.0, 0.5, 0.9, 1.0, 1.4))
    assert most_onsets(Song(notes, ())) == 4
    assert most_onsets(Song(notes, ()), 0.45) == 2
    assert most_onsets(Song((), ())) == 0


def test_hands_without_keys_are_refused():
    with pytest.raises(FieldError, match=r"hands\[1\]: is \[\], expected keys of 0 to 87"):
        random_song(np.random.default_rng(0), ((1, 2), ()))
    with pytest.raises(FieldError, match=r"0 notes a second"):
        random_song(np.random.default_rng(0), HANDS, notes_per_second=0)


def test_songs_by_name(tmp_path):
    robot = load_robot("lite_piano")
    assert named_song("random:3", robot) == held_out_songs(robot.piano.hands, 4)[3]
    assert len(named_song("twinkle", robot).notes) == 66
    (tmp_path / "mine.mid").write_bytes(song_path("leaps").read_bytes())
    assert named_song("mine.mid", robot, tmp_path) == named_song("leaps", robot)


@pytest.mark.parametrize(
    ("name", "robot", "message"),
    [
        ("twinkel", "lite_piano", r"^song: unknown song 'twinkel' \(did you mean 'twinkle'\?\); known: black_keys"),
        ("random:-1", "lite_piano", r"^song: is 'random:-1', expected random:N, N a whole number of at most 9 digits"),
        ("random:1", "lite", r"^song: is 'random:1', but 'lite' has no piano"),
    ],
)
def test_a_song_that_there_is_not(name, robot, message):
    with pytest.raises(InputError, match=message):
        named_song(name, load_robot(robot))
