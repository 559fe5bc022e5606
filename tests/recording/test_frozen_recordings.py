"""Recordings of earlier runs still come out bit for bit."""

from functools import partial
from pathlib import Path

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.replay import main as replay_main

RECORDINGS = Path(__file__).parents[1] / "data" / "recordings"

replay = partial(run_program, replay_main)


def modes(path):
    """The modes of a recorded run, one after the other."""
    walked = [tick.output.control_mode.mode for tick in open_recording(path).ticks()]
    return [mode for i, mode in enumerate(walked) if i == 0 or mode is not walked[i - 1]]


@pytest.mark.parametrize(("name", "ticks"), [("simulated_locomotion.mcap", 408), ("hardware_reactivated.mcap", 450)])
def test_a_frozen_recording_is_repeated_bit_for_bit(name, ticks, capsys):
    assert replay([str(RECORDINGS / name)]) == 0
    assert capsys.readouterr().out == f"{ticks} ticks, bit for bit identical\n"


def test_the_frozen_recordings_are_worth_replaying():
    assert Mode.LOCOMOTION in modes(RECORDINGS / "simulated_locomotion.mcap")
    assert modes(RECORDINGS / "hardware_reactivated.mcap") == [
        Mode.DAMPING,
        Mode.STANDBY,
        Mode.DAMPING,
        Mode.ZERO_TORQUE,  # the robot was activated afresh, and the stack began again
        Mode.DAMPING,
        Mode.STANDBY,
        Mode.DAMPING,
    ]
