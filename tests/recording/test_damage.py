"""Damage in the middle of a recording: it is read to there, and replay fails."""

from functools import partial

import pytest
from recorded_run import wobbled
from recording_samples import chunks, spoil, write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.record import main as record_main
from humanoid_sim.recording import recorder as recorder_module
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.replay import main as replay_main

record, replay = partial(run_program, record_main), partial(run_program, replay_main)

TICKS = 320


@pytest.fixture(scope="module")
def sample():
    header, ticks = wobbled()
    return header, ticks[:TICKS]


@pytest.fixture
def path(tmp_path, sample, monkeypatch):
    """A run in ten chunks of 32 ticks."""
    monkeypatch.setattr(recorder_module, "FLUSH_PERIOD", 1e9)
    write_chunks = recorder_module._RunWriter.tick

    def tick(self, item, message=None):
        write_chunks(self, item, message)
        if item.index % 32 == 31:
            self.flush()

    monkeypatch.setattr(recorder_module._RunWriter, "tick", tick)
    header, ticks = sample
    write_recording(tmp_path / "run.mcap", ticks, header)
    assert len(chunks(tmp_path / "run.mcap")) == 10
    return tmp_path / "run.mcap"


def test_by_itself_a_reader_stops_at_the_damage(path):
    spoil(path, 3)
    assert [tick.index for tick in open_recording(path).ticks()] == list(range(96))


def test_damage_of_a_killed_run_is_told_from_its_early_end(path, capsys):
    whole, end = path.read_bytes(), chunks(path)[8][1]
    path.write_bytes(whole[: end + 100])
    assert replay([str(path)]) == 0
    assert "288 ticks, bit for bit identical\nthe recording is not complete: cut at byte" in capsys.readouterr().out
    data = bytearray(whole[:end])
    data[end - 500] ^= 0xFF
    path.write_bytes(data)
    assert replay([str(path)]) == 1
    assert "256 ticks, bit for bit identical\nthe recording is not complete: damaged" in capsys.readouterr().out


def test_a_recording_without_ticks_is_no_success(tmp_path, sample, capsys):
    write_recording(tmp_path / "run.mcap", [], sample[0], events=[(0.0, "an event")])
    assert replay([str(tmp_path / "run.mcap")]) == 1
    assert capsys.readouterr().out == "the recording holds no ticks: there is nothing to repeat\n"


def test_ticks_out_of_order_are_no_success(tmp_path, sample, capsys):
    header, ticks = sample
    write_recording(tmp_path / "run.mcap", [*ticks[:40], *ticks[10:60]], header)
    assert replay([str(tmp_path / "run.mcap")]) == 1
    out = capsys.readouterr().out
    assert "40 ticks identical; tick 10, t = 0.200 s, differs\n  index: recorded 10, after 39, replayed 40" in out
