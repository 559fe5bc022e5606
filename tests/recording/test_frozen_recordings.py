"""Recordings of earlier runs still come out bit for bit."""

from pathlib import Path

import pytest

from humanoid_sim.replay import main as replay

RECORDINGS = Path(__file__).parents[1] / "data" / "recordings"


@pytest.mark.parametrize(("name", "ticks"), [("simulated_locomotion.mcap", 408), ("hardware_reactivated.mcap", 450)])
def test_a_frozen_recording_is_repeated_bit_for_bit(name, ticks, capsys):
    assert replay([str(RECORDINGS / name)]) == 0
    assert capsys.readouterr().out == f"{ticks} ticks, bit for bit identical\n"
