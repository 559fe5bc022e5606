"""A song on a simulated piano, and on emulated motors: goals, score, refusals."""

import json

import mido
import pytest

from humanoid_sim import record, replay
from humanoid_sim.cli import run_program


def saved_song(path, *notes, beats=1):
    """A MIDI file of notes, one after the other, at two beats a second."""
    track = mido.MidiTrack()
    for note in notes:
        track.append(mido.Message("note_on", note=note, time=60))
        track.append(mido.Message("note_off", note=note, time=480 * beats - 60))
    file = mido.MidiFile(ticks_per_beat=480)
    file.tracks.append(track)
    file.save(path)
    return str(path)


@pytest.fixture
def piano(make_robot):
    return "--robot", make_robot("lite_piano"), "--policy", "lite_piano"


def scored(recording, capfd):
    """What `record info` says of a run's song."""
    capfd.readouterr()
    assert run_program(record.main, ["info", recording, "--json"]) == 0
    return json.loads(capfd.readouterr().out)["piano"]


def test_a_song_is_played_and_scored(run, piano, tmp_path, capfd):
    result = run(*piano, "--motion", saved_song(tmp_path / "song.mid", 60, 62, 64, 108, 65, 67), "--html", "none")
    assert result.status == 0
    assert "left out of the song, beyond reach or more notes at a time than fingers: C8" in result.out
    found = result.summary["piano"]
    assert found["precision"] > 0.9
    assert 0.6 < found["f1"] < 0.95
    assert scored(result.summary["recording"], capfd) == found


def test_a_song_that_nobody_can_play_is_one_line(run, piano, tmp_path):
    result = run(*piano, "--motion", saved_song(tmp_path / "high.mid", 108, 107, 105))
    assert result.status == 2
    assert "has no note that 'lite_piano' can reach: A7, B7, C8" in result.err


@pytest.mark.soak
def test_on_emulated_motors_the_policy_hears_the_keys_that_it_presses(run, piano, tmp_path, capfd):
    walk = "hold 0.3; damp; hold 0.1; load_a; wait; hold 0.5; start_locomotion; hold 3; damp; hold 0.1"
    options = ("--motion", saved_song(tmp_path / "song.mid", 55, beats=8), "--script", walk)
    result = run(*piano, "--hardware", "virtual:piano", "--allow-script", *options)
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    driven = [tick for tick in result.ticks if tick.output.policy_step is not None]
    assert driven[-1].input.state.extern["key_pressed"].value.nonzero()[0].tolist() == [55 - 21]
    assert run_program(replay.main, ["r.mcap"]) == 0
    assert scored("r.mcap", capfd)["f1"] > 0.8
