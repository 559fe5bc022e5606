"""That every figure can be taken and printed; what they come to is the machine's business."""

import json
import subprocess
import sys
from dataclasses import replace

import pytest

from humanoid_sim.cli import run_program
from tools.bench import batches, figures, main, one_robot, plants
from tools.bench.timing import Row


@pytest.fixture
def run(capsys, monkeypatch):
    """Run `bench` with blocks of a few ticks and steps: status, stdout, stderr."""
    monkeypatch.setattr(one_robot, "_BLOCK", 8)
    monkeypatch.setattr(one_robot, "_STEPS", 3)
    monkeypatch.setattr(batches, "_MANY", 6)
    monkeypatch.setattr(batches, "_SOME", 2)
    monkeypatch.setattr(batches, "_PIANO_MANY", 4)
    monkeypatch.setattr(batches, "_SCANNING", 4)
    monkeypatch.setattr(batches, "_EPISODES", 4)
    monkeypatch.setattr(plants, "_MANY", 4)
    monkeypatch.setattr(plants, "_SECONDS", 0.1)
    monkeypatch.setattr(figures, "_SECONDS", 1.0)
    monkeypatch.setenv("COLUMNS", "200")

    def bench(*arguments):
        capsys.readouterr()
        try:
            status = run_program(main, arguments)
        except SystemExit as stop:
            status = int(stop.code or 0)
        return status, *capsys.readouterr()

    return bench


def fake(monkeypatch, **rows):
    """Put rows in the place of what is measured; gives the list of what was asked for."""
    asked = []

    def taker(name, row):
        return lambda repetitions: asked.append((name, repetitions)) or [row]

    monkeypatch.setattr(figures, "_BENCHMARKS", {name: taker(name, row) for name, row in rows.items()})
    return asked


GOOD = Row("quick thing", 1.5, "ratio", 1.25, 1.75, 2.5, "3 µs")
BAD = Row("slow thing", 3.0, "ratio", 2.0, 4.0, 2.5)
FREE = Row("other thing", 7.0, "µs", 6.0, 8.0)
FAST = Row("fast thing", 2.0, "ratio", 1.9, 2.1, 1.9, at_least=True)


TARGETS = {
    "control tick of play at 200 Hz": 2.5,
    "play --help": 15.0,
    "supervisor step, ZERO_TORQUE": None,
    "supervisor step, DAMPING": None,
    "supervisor step, STANDBY": None,
    "supervisor step, LOCOMOTION, command held": None,
    "recording, per tick": None,
    "feed, per tick": 20.0,
    "play, times real time": None,
    "LiteTracking-v0.step": 1.4,
    "vector, 6 environments, over bare rollout": 0.85,
    "vector, over SyncVectorEnv": 1.9,
    "piano, physics step": None,
    "piano vector, 4 environments, over bare rollout": 0.8,
    "height scan, 4 robots, over none": None,
    "implicit plant over affine, LiteTracking-v0": 4.0,
    "implicit plant over affine, BipedVelocity-v0": 3.0,
    "implicit plant, error": 0.5,
    "regress, 4 episodes, over bare rollout": 0.7,
}


def _is_within(row):
    return bool(row["value"] >= row["target"] if row["at_least"] else row["value"] <= row["target"])


def test_every_figure_can_be_taken(run, monkeypatch):
    quick = {name: take for name, take in figures._BENCHMARKS.items() if name != "hardware loop"}
    monkeypatch.setattr(figures, "_BENCHMARKS", quick)
    status, out, _ = run("--repetitions", "1", "--json")
    document = json.loads(out)
    rows = {row["name"]: row for row in document["rows"]}
    targets = {name: row["target"] for name, row in rows.items()}
    assert list(targets.items()) == list(TARGETS.items())
    assert 0.01 < rows["implicit plant, error"]["value"] < 0.5
    for row in rows.values():
        assert row["low"] <= row["value"] <= row["high"]
        assert row["at_least"] == row["name"].startswith(("vector", "piano vector", "regress", "implicit plant over"))
        assert row["met"] == (row["target"] is None or _is_within(row))
    for name in ("control tick of play at 200 Hz", "play --help", "play, times real time"):
        assert rows[name]["value"] > 0.0
    assert set(document["machine"]) == {"cpus", "platform", "python", "mujoco", "onnxruntime", "humanoid_sim"}
    assert status == (0 if all(row["met"] for row in rows.values()) else 1)


@pytest.mark.slow
def test_the_hardware_loop_can_be_measured(run):
    status, out, _ = run("--only", "hardware loop", "--json")
    overruns, tick = json.loads(out)["rows"]
    assert (overruns["name"], overruns["target"]) == ("hardware loop, overruns in 60 s", 0.0)
    assert overruns["met"] == _is_within(overruns)
    assert tick["value"] > 0.0
    assert status == (0 if overruns["met"] else 1)


def test_a_missed_target_is_status_1(run, monkeypatch):
    fake(monkeypatch, good=GOOD, free=FREE)
    assert run()[0] == 0
    fake(monkeypatch, good=GOOD, bad=BAD)
    assert run()[0] == 1
    fake(monkeypatch, slow=replace(FAST, value=1.89))
    assert run()[0] == 1


def test_the_table_shows_figures_ranges_and_targets(run, monkeypatch):
    asked = fake(monkeypatch, good=GOOD, free=FREE, fast=FAST)
    _, out, _ = run("--repetitions", "3")
    assert asked == [("good", 3), ("free", 3), ("fast", 3)]
    lines = {line.split("│")[1].strip(): line for line in out.splitlines() if "thing" in line}
    assert [cell.strip() for cell in lines["quick thing"].split("│")[2:-1]] == ["1.50", "1.25–1.75", "≤ 2.5", "3 µs"]
    assert [cell.strip() for cell in lines["other thing"].split("│")[2:-1]] == ["7.00 µs", "6.00–8.00", "", ""]
    assert [cell.strip() for cell in lines["fast thing"].split("│")[2:-1]] == ["2.00", "1.90–2.10", "≥ 1.9", ""]
    assert "medians of 3 repetitions" in out


def test_only_what_was_asked_for_is_measured(run, monkeypatch):
    asked = fake(monkeypatch, **{"control tick": GOOD, "play --help": FREE})
    run("--only", "tick")
    assert asked == [("control tick", 15)]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            ("--only", "speed"),
            "error: --only: is 'speed', expected part of one of control tick, play --help, supervisor step, recording, "
            "feed, real time, LiteTracking-v0.step, vector, piano, height scan, implicit plant, regress, "
            "hardware loop\n",
        ),
        (("--repetitions", "0"), "error: --repetitions: is 0, expected a whole number >= 1\n"),
        (("--repetitions", "-3"), "error: --repetitions: is -3, expected a whole number >= 1\n"),
    ],
)
def test_a_bad_option_is_one_line(options, expected, run):
    assert run(*options) == (2, "", expected)


@pytest.mark.parametrize("options", [("--repetitions", "many"), ("--bogus",), ("extra",)])
def test_what_the_parser_refuses_names_the_option(options, run):
    status, out, err = run(*options)
    assert (status, out) == (2, "")
    assert options[0] in err
    assert "'python -m tools.bench --help'" in err


def test_the_package_says_where_it_is_now():
    command = [sys.executable, "-m", "humanoid_sim.bench", "--json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == "error: bench is not part of the package any more; in a checkout: make bench\n"
