"""Recordings of one policy laid beside one another."""

import json

import numpy as np
import pytest

from humanoid_sim import compare
from humanoid_sim.cli import run_program
from humanoid_sim.compare import PolicyRun, compare_runs, read_policy_run
from humanoid_sim.errors import InputError

SCRIPT = "damp; hold 0.1; load_a; wait; start_locomotion; hold 0.6; damp"


def policy_run(name, offset, first=0, joints=("a", "b")):
    frames = {first + i: i for i in range(4)}
    row = np.array([[0.1 * frame] * len(joints) for frame in frames]) + offset
    return PolicyRun(name, joints, frames, row, 2.0 * row, row[:, :1], np.full_like(row, abs(offset)))


def test_runs_are_compared_where_they_show_the_same_frames():
    reference = policy_run("bus", 0.0)
    near, far = policy_run("delayed", 0.01, first=1), policy_run("direct", -0.04)
    first, second = compare_runs(reference, [far, near])
    assert (first.name, first.frames, first.explained) == ("direct", 4, None)
    assert first.position_rms == pytest.approx(0.04)
    assert first.position_max == pytest.approx(0.04)
    assert first.velocity_rms == pytest.approx(0.08)
    assert first.action_rms == pytest.approx(0.04)
    assert first.joint_age == pytest.approx(0.04)
    assert (second.name, second.frames) == ("delayed", 3)  # frames 1 to 3
    assert second.position_rms == pytest.approx(0.01)
    assert second.explained == pytest.approx(0.75)


def test_each_joints_distance_is_told_the_farthest_first(capsys):
    reference, other = policy_run("old", 0.0), policy_run("new", 0.0)
    other.joint_position[:, 1] += [0.03, -0.03, 0.05, -0.05]
    (distance,) = compare_runs(reference, [other])
    assert distance.by_joint == pytest.approx({"a": 0.0, "b": 0.001 * 1700.0**0.5})
    compare._print_joints([distance])
    rows = [line.split("│")[1:-1] for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    assert [[cell.strip() for cell in row] for row in rows] == [["b", "41.23"], ["a", "0.00"]]


def test_what_cannot_be_compared_is_refused():
    reference = policy_run("bus", 0.0)
    with pytest.raises(InputError, match="other: has other joints or actions than bus"):
        compare_runs(reference, [policy_run("other", 0.0, joints=("a", "c"))])
    with pytest.raises(InputError, match="late: has no frame of the motion in common with bus"):
        compare_runs(reference, [policy_run("late", 0.0, first=10)])


def test_recordings(run, quick, folder, capfd):
    options = ("--robot", quick, "--script", SCRIPT, "--control-frequency", "50")
    late = ("--state-delay", "0.004", "--command-delay", "0.002")
    for name, delays in (("late.mcap", late), ("direct.mcap", ())):
        assert run(*options, *delays, "--record", name, record=False).status == 0
    late_run = read_policy_run(folder / "late.mcap")
    steps = len(late_run.frames)
    assert 25 <= steps <= 35
    capfd.readouterr()
    assert run_program(compare.main, ["late.mcap", "direct.mcap", "late.mcap", "--json"]) == 0
    direct, same = json.loads(capfd.readouterr().out)["others"]
    assert direct["frames"] == same["frames"] == steps
    assert direct["position_rms"] > 1e-5
    assert direct["joint_age"] == 0.0
    assert (same["position_rms"], same["action_rms"], same["explained"]) == (0.0, 0.0, 1.0)
    assert same["joint_age"] == pytest.approx(0.004)
    assert run_program(compare.main, ["late.mcap", "direct.mcap", "late.mcap"]) == 0
    assert "100 %" in capfd.readouterr().out


def test_a_recording_without_a_policy_is_one_line(run, quick, capfd):
    assert run("--robot", quick, "--script", "damp", "--record", "r.mcap", record=False).status == 0
    capfd.readouterr()
    assert run_program(compare.main, ["r.mcap", "r.mcap"]) == 2
    assert capfd.readouterr().err == "error: r.mcap: no policy ran in it, expected a recording with LOCOMOTION\n"
    assert run_program(compare.main, ["no.mcap", "r.mcap"]) == 2
