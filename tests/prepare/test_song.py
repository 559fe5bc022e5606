"""`prepare --song`: a MIDI file becomes the goals of a piano policy."""

import mido
import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.prepare import main


@pytest.fixture
def midi(tmp_path):
    track = mido.MidiTrack()
    for note in (60, 64, 67, 105):
        track += [mido.Message("note_on", note=note), mido.Message("note_off", note=note, time=480)]
    file = mido.MidiFile()
    file.tracks.append(track)
    path = tmp_path / "a tune.mid"
    file.save(path)
    return path


def run(midi, *words):
    given = ["--song", str(midi), "--robot", "lite_piano", "--output", str(midi.parent / "out")]
    return run_program(main, [*given, *words])


def test_a_song_becomes_goals_within_the_robot_s_reach(midi, capsys):
    assert run(midi, "--fps", "25") == 0
    motion = read_motion(midi.parent / "out" / "a_tune.mcap")
    assert (motion.task_type, motion.policy_dt, motion.robot) == ("piano", 0.04, "lite_piano")
    assert np.flatnonzero(motion.frames.any(axis=0)).tolist() == [39, 43, 46]
    assert not motion.frames[:25].any()  # the hands come over the keys
    printed = capsys.readouterr().out
    assert "3 of 4 notes" in printed
    assert "left out, beyond reach or too many at a time: A7" in printed


def test_a_song_for_a_policy_has_its_rate(midi, capsys):
    assert run(midi, "--policy", "lite_tracking") == 2
    assert "task_type tracking, expected piano" in capsys.readouterr().err
    assert not (midi.parent / "out").exists()
    assert run(midi, "--policy", "lite_piano", "--fps", "10") == 2
    assert "--fps: is given" in capsys.readouterr().err
    assert run(midi, "--policy", "lite_piano", "--name", "low") == 0
    assert read_motion(midi.parent / "out" / "low.mcap").policy_dt == 0.02
