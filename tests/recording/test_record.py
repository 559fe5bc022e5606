"""`record info` as a user meets it."""

import json
from dataclasses import replace

import pytest
from recorded_run import COUNT, PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.record import main as record


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "140")
    header, ticks = wobbled()
    ticks = [replace(ticks[0], overrun=True), *ticks[1:]]
    write_recording(tmp_path / "run.mcap", ticks, header, events=[(3.5, "the support let go")])
    return tmp_path / "run.mcap"


def test_info_as_json(path, capsys):
    assert record(["info", str(path), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["robot"], info["damage"]) == ("lite", "")
    assert (info["ticks"], info["missing_ticks"], info["overruns"], info["inferences"]) == (COUNT, 0, 1, 21)
    modes = ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING", "STANDBY", "REMOTE", "DAMPING"]
    assert [span["mode"] for span in info["modes"]] == modes
    assert info["modes"][3]["start"] == pytest.approx(210 * PERIOD)
    assert [len(info[kind]) for kind in ("events", "faults", "refusals", "safety")] == [1, 1, 1, 1]
    assert info["safety"][0]["message"] == "safety FAULT RX_TIMEOUT from can0: wrist"


def test_info_for_a_person(path, capsys):
    assert record(["info", str(path)]) == 0
    out = capsys.readouterr().out
    for text in ("lite, 14 joints", "560 at 50 Hz, 1 overruns", "START_LOCOMOTION", "the support let go", " of 14 "):
        assert text in out
    path.write_bytes(path.read_bytes()[:-60])
    assert record(["info", str(path)]) == 0
    assert "not complete: cut" in capsys.readouterr().out
