"""`piano` on recordings of keys that were played."""

import json
from dataclasses import replace

import numpy as np
import pytest
from recording_samples import make_header, make_tick, write_recording

from humanoid_sim import piano
from humanoid_sim.cli import run_program
from humanoid_sim.messages import PolicyStep
from humanoid_sim.mit import Extern
from humanoid_sim.policy.motion import Motion, motion_bytes

SONG = np.zeros((6, 88), dtype=np.float32)
SONG[1:3, 39] = SONG[3:5, 43] = 1.0


def recorded(path, pressed, song):
    ticks = []
    for frame, keys in enumerate(pressed):
        tick = make_tick(40 + 4 * frame, policy_step=PolicyStep(frame, np.zeros(5), np.zeros(2)))
        state = replace(tick.input.state, extern={"key_pressed": Extern(keys, tick.input.state.time)})
        ticks.append(replace(tick, input=replace(tick.input, state=state)))
    attachments = {} if song is None else {"motion.mcap": motion_bytes(song)}
    write_recording(path, ticks, make_header(attachments=attachments))
    return path


def song(frames=SONG, **changes):
    return Motion(frames, (), 0.02, **{"task_type": "piano", **changes})


def test_a_run_is_scored_against_its_song(tmp_path, capsys):
    pressed = SONG.copy()
    pressed[4, 43] = 0.0
    pressed[5, 50] = 1.0
    path = recorded(tmp_path / "run.mcap", pressed, song())
    assert piano.main([str(path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == {
        "precision": pytest.approx(5 / 6),
        "recall": pytest.approx(5 / 6),
        "f1": pytest.approx(4 / 6),
    }


@pytest.mark.parametrize(
    ("motion", "width", "message"),
    [
        (None, 88, "holds no song; give one"),
        (song(np.zeros((6, 9)), task_type="tracking"), 88, "its motion is for task_type tracking, expected a song"),
        (song(), 12, "has 12 keys, and the song 88"),
    ],
)
def test_what_cannot_be_scored_is_one_line(motion, width, message, tmp_path, capsys):
    path = recorded(tmp_path / "run.mcap", np.zeros((6, width)), motion)
    assert run_program(piano.main, [str(path)]) == 2
    assert message in capsys.readouterr().err
