"""A song on a simulated piano, played by a network that knows two of its keys: goals, score, refusals."""

import json

import mido
import numpy as np
import pytest
from models import contract_of, linear_model, saved

from humanoid_sim import record, replay
from humanoid_sim.cli import run_program
from humanoid_sim.policy.readers.own import write_metadata
from humanoid_sim.robots.description import load_robot

_KEYS = (34, 53)
"""G3 for the left hand, D5 for the right."""
_ABOVE = (-0.4768, 0.0310, -1.0887, -2.0515, -0.0761, 0.2430, -0.3723)
"""rad, commands that hold the left finger 6 mm above its key; the right arm's are mirrored."""
_DOWN = (-0.4452, -0.0303, -1.1206, -1.9981, -0.0772, 0.2643, -0.3491)
"""rad, commands that press it to 0.9 of its travel."""
_MIRRORED = (1, -1, -1, 1, -1, 1, -1)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """It presses each of two keys, one a hand, while the song asks for it: action = their goals, each times a pose."""
    robot = load_robot("lite_piano")
    above = np.concatenate([_ABOVE, np.multiply(_MIRRORED, _ABOVE)])
    down = np.concatenate([_DOWN, np.multiply(_MIRRORED, _DOWN)])
    weights = np.zeros((2 * 88, robot.joint_count), dtype=np.float32)
    for key, arm in zip(_KEYS, (slice(0, 7), slice(7, 14)), strict=True):
        weights[key, arm] = (down - above)[arm]
    contract = contract_of(
        robot.joint_names,
        task_type="piano",
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=above,
        observation=("target_keys", "key_pressed"),
    )
    path = tmp_path_factory.mktemp("policy") / "two_keys.onnx"
    return saved(path, linear_model(write_metadata(contract), matrix=weights))


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


def test_a_song_is_played_and_scored(run, make_robot, policy, song, capfd):
    result = run("--robot", make_robot("lite_piano"), "--policy", str(policy), "--motion", str(song), "--html", "none")
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


@pytest.mark.soak
def test_on_emulated_motors_the_policy_hears_the_keys_that_it_presses(run, make_robot, policy, tmp_path, capfd):
    song = saved_song(tmp_path / "song.mid", [(55, 2, 8)])
    walk = "hold 0.3; damp; hold 0.1; load_a; wait; hold 0.5; start_locomotion; hold 3; damp; hold 0.1"
    options = ("--policy", str(policy), "--motion", str(song), "--script", walk)
    result = run("--robot", make_robot("lite_piano"), "--hardware", "virtual:piano", "--allow-script", *options)
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    driven = [tick for tick in result.ticks if tick.output.policy_step is not None]
    assert driven[-1].input.state.extern["key_pressed"].value.nonzero()[0].tolist() == [_KEYS[0]]
    assert driven[-1].output.policy_step.observation[88 + _KEYS[0]] == 1.0
    assert run_program(replay.main, ["r.mcap"]) == 0
    capfd.readouterr()
    assert run_program(record.main, ["info", "r.mcap", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["piano"]["f1"] > 0.8
