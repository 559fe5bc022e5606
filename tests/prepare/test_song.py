"""`prepare --song`: files of a song, and what is said of it."""

import json

import mido
import numpy as np
import pytest

from humanoid_sim import prepare
from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.policy.motion import read_motion

POLICY = asset_path("policies", "lite_tracking.onnx")


@pytest.fixture
def midi(tmp_path):
    track = mido.MidiTrack()
    for note in (60, 64, 67, 100):
        track += [mido.Message("note_on", note=note), mido.Message("note_off", note=note, time=480)]
    file = mido.MidiFile()
    file.tracks.append(track)
    path = tmp_path / "a tune.mid"
    file.save(path)
    return path


def run(midi, *words):
    return run_program(prepare.main, ["--song", str(midi), "--output", str(midi.parent / "out"), *words])


def test_a_song_becomes_goals_and_a_report(midi, capsys):
    assert run(midi, "--keys", "C4-C6", "--fps", "25") == 0
    out = midi.parent / "out"
    assert sorted(path.name for path in out.iterdir()) == ["a_tune.json", "a_tune.mcap"]
    motion = read_motion(out / "a_tune.mcap")
    assert (motion.task_type, motion.policy_dt, motion.frames.shape[1]) == ("piano", 0.04, 88)
    assert np.flatnonzero(motion.frames.any(axis=0)).tolist() == [39, 43, 46]
    report = json.loads((out / "a_tune.json").read_text())
    assert report["left_out"] == {"beyond the keys": {"E7": 1}, "too many voices": {}}
    assert (report["notes"], report["lowest"], report["highest"]) == (3, "C4", "G4")
    assert "left out, beyond the keys: E7; --transpose moves the song" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--keys", "C1-C2"], "none of its 4 notes is between C1 and C2; they are between C4 and E7: try --transpose"),
        (["--keys", "C6-C4"], "--keys: is 'C6-C4', expected the lowest and the highest key of A0 to C8, such as C3-C6"),
        (["--keys", "4"], "--keys: is '4', expected"),
        (["--voices", "0"], "--voices: is 0, expected at least 1"),
        (["--policy", str(POLICY)], "is a policy of task_type tracking, which plays no songs, and --song is given"),
        (["--motion", "x.npz"], "--motion and --song: both are given, expected one of them"),
    ],
)
def test_mistakes_leave_nothing(midi, words, message, capsys):
    assert run(midi, *words) == 2
    assert message in capsys.readouterr().err
    assert not (midi.parent / "out").exists()
