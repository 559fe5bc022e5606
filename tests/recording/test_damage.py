"""Damage in the middle of a recording: what lies behind it is read, what is missing is counted, and replay fails."""

import json
from functools import partial

import pytest
from recorded_run import wobbled
from recording_samples import bits, chunks, spoil, write_recording

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


def lost(*numbers):
    """Ticks of these chunks."""
    return {32 * number + i for number in numbers for i in range(32)}


def test_a_sound_run_is_read_alike_with_and_without_going_past_damage(path):
    recording = open_recording(path)
    plain = [bits(entry) for entry in recording.entries()]
    assert [bits(entry) for entry in recording.entries(past_damage=True)] == plain
    assert (recording.is_complete, recording.is_damaged, recording.lost_at_end) == (True, False, 0)


@pytest.mark.parametrize("spoiled", [(3,), (3, 4), (2, 7), (0,), (9,), (0, 5, 9)])
def test_everything_but_the_damaged_chunks_is_read(path, sample, spoiled):
    spoil(path, *spoiled)
    recording = open_recording(path)
    read = list(recording.entries(past_damage=True))
    assert {tick.index for tick in read} == set(range(TICKS)) - lost(*spoiled)
    assert all(bits(tick) == bits(sample[1][tick.index]) for tick in read)
    assert (recording.is_complete, recording.is_damaged) == (False, True)
    assert recording.damage.count("damaged") == len(spoiled)
    assert recording.lost_at_end == (32 if 9 in spoiled else 0)


def test_by_itself_a_reader_stops_at_the_damage(path):
    """Only who counts what is missing may go on: a jump in time would be no trajectory."""
    spoil(path, 3)
    assert [tick.index for tick in open_recording(path).ticks()] == list(range(96))


@pytest.mark.parametrize("name", ["the length is too long", "the length is too short", "a stretch is zeros"])
def test_the_next_chunk_is_found_where_lengths_are_lost(path, name):
    data = bytearray(path.read_bytes())
    start = chunks(path)[3][0] - 60
    assert data[start] == 6
    if name == "a stretch is zeros":
        data[start - 20 : start + 900] = bytes(920)
    else:
        data[start + 1 : start + 9] = (1 << 40 if name.endswith("long") else 70).to_bytes(8, "little")
    path.write_bytes(data)
    recording = open_recording(path)
    read = {tick.index for tick in recording.entries(past_damage=True)}
    assert set(range(TICKS)) - read == lost(3)
    assert recording.is_damaged


def test_replay_counts_what_is_missing(path, capsys):
    spoil(path, 3, 7)
    assert replay([str(path)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == (
        "96 ticks identical; then 32 ticks are missing from the recording (up to tick 128, t = 2.560 s), "
        "and the 160 that follow cannot be repeated"
    )
    assert lines[1] == "64 of 320 ticks are missing in all"
    assert lines[2].startswith("the recording is not complete: damaged (")
    assert replay([str(path), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["identical"], result["missing_ticks"], result["complete"]) == (False, 64, False)


@pytest.mark.parametrize(("spoiled", "repeated"), [(9, 288), (0, 0)])
def test_replay_counts_what_is_missing_at_either_end(path, capsys, spoiled, repeated):
    spoil(path, spoiled)
    assert replay([str(path)]) == 1
    out = capsys.readouterr().out
    assert out.startswith(f"{repeated} ticks")
    assert "32 of 320 ticks are missing in all" in out


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


def test_info_counts_too(path, capsys):
    spoil(path, 3, 9)
    assert record(["info", str(path), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["complete"], info["ticks"], info["missing_ticks"]) == (False, 256, 64)


def test_recover_goes_on_behind_the_damage_and_says_what_it_dropped(path, sample, capsys):
    spoil(path, 3, 9)
    assert record(["recover", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{path}: damaged (")
    assert lines[0].count(" at byte ") == 2
    words = lines[1].split()
    assert lines[1] == f"dropped: at least {words[3]} messages, at 2 places"
    assert int(words[3]) >= 64
    assert lines[2] == "missing: 64 ticks of the run; a replay ends before the first of them"
    output = path.with_name("run.recovered.mcap")
    recovered = open_recording(output)
    assert {tick.index for tick in recovered.ticks()} == set(range(TICKS)) - lost(3, 9)
    assert all(bits(tick) == bits(sample[1][tick.index]) for tick in recovered.ticks())
    assert recovered.is_complete
    assert replay([str(output)]) == 1
    assert "then 32 ticks are missing from the recording" in capsys.readouterr().out


def test_recover_reads_the_definitions_of_a_lost_first_chunk_from_the_index(path, capsys):
    whole, first, end = path.read_bytes(), sum(chunks(path)[0]) // 2, chunks(path)[8][1]
    spoil(path, 0)
    assert record(["recover", str(path), "-o", str(path.with_name("a.mcap"))]) == 0
    assert [tick.index for tick in open_recording(path.with_name("a.mcap")).ticks()] == list(range(32, TICKS))
    capsys.readouterr()
    # Without an index nothing says what the messages are.
    data = bytearray(whole[:end])
    data[first] ^= 0xFF
    path.write_bytes(data)
    assert record(["recover", str(path), "-o", str(path.with_name("b.mcap"))]) == 0
    dropped = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("dropped: "))
    assert int(dropped.split()[3]) > 9 * 32
    assert list(open_recording(path.with_name("b.mcap")).ticks()) == []
