"""A song on a simulated piano, played by a network that knows two of its keys: goals, score, refusals."""

import json

import mido
import pytest
from play_fixtures import quick_robot
from two_keys import two_key_policy

from humanoid_sim import record
from humanoid_sim.cli import run_program


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    return two_key_policy(tmp_path_factory.mktemp("policy") / "two_keys.onnx")


def saved_song(path, *voices):
    """A MIDI file of voices at two beats a second: (note, beat[, beats]); an eighth of a beat between two notes."""
    file = mido.MidiFile(ticks_per_beat=480)
    for voice in voices:
        track, now = mido.MidiTrack(), 0
        for note, beat, *length in voice:
            start, end = 480 * beat, 480 * (beat + (length or [1])[0]) - 60
            track.append(mido.Message("note_on", note=note, time=start - now))
            track.append(mido.Message("note_off", note=note, time=end - start))
            now = end
        file.tracks.append(track)
    file.save(path)
    return path


@pytest.fixture
def song(tmp_path):
    """D5 and G3, which the network plays, a C8 that nobody reaches, and an A3 that it does not know."""
    path = tmp_path / "song.mid"
    return saved_song(path, [(74, 0), (74, 2), (108, 3), (74, 5, 2)], [(55, 1, 2), (55, 4), (57, 5)])


def test_a_song_is_played_and_scored(folder, run, policy, song, tmp_path, capfd):
    robot = quick_robot(tmp_path, "lite_piano")
    result = run("--robot", robot, "--policy", str(policy), "--motion", str(song), "--html", "none")
    assert result.status == 0
    assert "left out of the song, beyond reach or more notes at a time than fingers: C8" in result.out
    found = result.summary["piano"]
    assert found["precision"] > 0.95
    assert 0.75 < found["f1"] < 0.95
    recording = result.summary["recording"]
    assert run_program(record.main, ["info", recording, "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["piano"] == found


def test_a_song_that_nobody_can_play_is_one_line(run, policy, tmp_path):
    high = saved_song(tmp_path / "high.mid", [(108, 0), (107, 1)], [(105, 1)])
    result = run("--robot", "lite_piano", "--policy", str(policy), "--motion", str(high))
    assert result.status == 2
    assert "has no note that 'lite_piano' can reach: A7, B7, C8" in result.err
