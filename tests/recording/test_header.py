"""Headers that a stranger wrote, with a digest that is right."""

import json
from functools import partial

import pytest
from recording_samples import make_header, make_tick, write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.record import main as record_main
from humanoid_sim.recording import header as header_module
from humanoid_sim.recording.header import HeaderError, parse_header
from humanoid_sim.recording.reader import open_recording, recorded_settings
from humanoid_sim.replay import main as replay_main

record, replay = partial(run_program, record_main), partial(run_program, replay_main)
GOOD = {
    "format": "2",
    "robot": "tiny",
    "joint_names": '["a", "b"]',
    "control_period": "0.02",
    "start_time_ns": "0",
    "observation_terms": '[["joint_pos", 2]]',
    "attachments": "[]",
}


def parse(**changes):
    fields = {**GOOD, **changes}
    return parse_header({**fields, "digest": header_module._digest(fields, {})}, {}, {})


def test_a_sound_header():
    assert parse().joint_names == ("a", "b")
    assert parse().control_period == 0.02


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"control_period": "0"}, "control_period: is 0, expected 1e-06 to 1000 s"),
        ({"control_period": "nan"}, "control_period: is nan, expected 1e-06 to 1000 s"),
        ({"control_period": "-0.02"}, "control_period: is -0.02, expected 1e-06 to 1000 s"),
        ({"joint_names": "[]"}, "joint_names: expected at least one, each once"),
        ({"joint_names": '["a", "a"]'}, "joint_names: expected at least one, each once"),
        ({"joint_names": "[1, 2]"}, "joint_names: expected a list of texts"),
        ({"joint_names": '{"a": 1}'}, "joint_names: expected a list of texts"),
        ({"attachments": "[[1]]"}, "attachments: expected a list of texts"),
        ({"start_time_ns": str(2**70)}, "start_time_ns: expected nanoseconds in 64 bits"),
        ({"observation_terms": '[["x", 1e9]]'}, "observation_terms: expected names and widths"),
    ],
)
def test_an_absurd_header_is_refused(changes, problem):
    with pytest.raises(HeaderError) as refused:
        parse(**changes)
    assert problem in str(refused.value)


@pytest.mark.parametrize("settings", ["{", "[]", "null", "NaN"], ids=lambda text: text[:4])
def test_settings_that_are_no_json_object(tmp_path, settings, capsys):
    path = tmp_path / "run.mcap"
    write_recording(path, [make_tick(0), make_tick(1)], make_header(documents={"settings": settings}))
    with pytest.raises(InputError, match="'settings'"):
        recorded_settings(path, open_recording(path).header)
    assert record(["info", str(path)]) == 0  # which shows what there is
    assert record(["info", str(path), "--json"]) == 0
    capsys.readouterr()
    assert replay([str(path), "--infer"]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f"error: {path}: its header's 'settings' are")
    assert line.count("\n") == 1


def test_settings_that_are_missing_are_empty(tmp_path):
    assert recorded_settings(tmp_path, make_header(documents={})) == {}
    assert recorded_settings(tmp_path, make_header(documents={"settings": json.dumps({"a": 1})})) == {"a": 1}
