"""The sample songs: their files are what the code makes, and two hands with a finger each can play them."""

from itertools import pairwise

import pytest

from humanoid_sim.assets import asset_path, sample_songs
from humanoid_sim.policy.song import key_name, read_song
from tools.samples import main
from tools.samples.songs import SONGS, most_onsets


@pytest.fixture(params=sorted(SONGS))
def song(request):
    return read_song(asset_path("songs", f"{request.param}.mid"))


def test_the_shipped_files_are_what_the_code_makes_byte_for_byte(tmp_path, capsys):
    assert main(["songs", "--output", str(tmp_path / "songs")]) == 0
    made = {path.name: path.read_bytes() for path in (tmp_path / "songs").iterdir()}
    shipped = {path.name: path.read_bytes() for path in asset_path("songs").iterdir()}
    assert made == shipped
    assert sample_songs() == tuple(sorted(SONGS))
    assert "ode_to_joy.mid: Ode to Joy, after L. van Beethoven (1824)" in capsys.readouterr().out


def test_two_hands_can_play_them(song):
    """One finger a hand: it leaves a key before it strikes the next, and the hands keep apart."""
    assert most_onsets(song) <= 3
    assert song.tracks[1:] == ("upper voice", "lower voice")
    upper, lower = ([note for note in song.notes if note.track == track] for track in (1, 2))
    assert len(upper) >= 8
    assert len(lower) >= 4
    for voice in (upper, lower):
        assert min(b.start - a.end for a, b in pairwise(voice)) > 0.05
    assert min(note.key for note in upper) - max(note.key for note in lower) >= 5
    assert 9.0 < song.seconds < 75.0


def test_the_tune_is_the_one_that_everybody_knows():
    ode = read_song(asset_path("songs", "ode_to_joy.mid"), tracks=[1])
    names = [key_name(note.key)[0] for note in ode.notes]
    assert "".join(names[:15]) == "EEFGGFEDCCDEEDD"
    assert "".join(names[-15:]) == "EEFGGFEDCCDEDCC"
    jacques = read_song(asset_path("songs", "frere_jacques.mid"))
    upper, lower = ([note for note in jacques.notes if note.track == track] for track in (1, 2))
    assert [note.key - 24 for note in upper] == [note.key for note in lower], "a canon"
    assert lower[0].start - upper[0].start == pytest.approx(8.0)
