"""A robot is brought up first, and gets its policy later: `play`, `mode` and the client from outside."""

import json

import pytest
from loaded_session import LONG, playing, quit_and_replay
from play_fixtures import quick_robot

from humanoid_sim import mode
from humanoid_sim.cli import run_program
from humanoid_sim.client import find_session
from humanoid_sim.messages import EventKind, Mode


def test_a_policy_is_loaded_in_standby_and_walks_and_the_recording_replays(folder, capfd):
    with playing(folder, "--policy", "none", "--pace", "realtime", "--robot", quick_robot(folder)) as session:
        session.stand()
        refused = session.intake.ask("start_locomotion", LONG)
        assert not refused.granted
        assert refused.text.endswith("no policy is loaded: humanoid_sim.mode load POLICY loads one")
        assert session.feed.document("contract") == ""
        assert session.feed.session.policy == "none"
        assert run_program(mode.main, ["load", "lite_tracking", "--motion", "circle"]) == 0
        told = capfd.readouterr().out
        assert "policy loaded: " in told
        assert "golden vectors: 8 samples" in told
        assert find_session().policy.endswith("lite_tracking.onnx")
        assert session.feed.follow()
        assert json.loads(session.feed.document("contract"))["task_type"] == "tracking"
        assert set(session.feed.blobs) == {"model.mjb", "motion.mcap"}
        session.walk()
        driven = session.intake.load("lite_tracking")
        assert driven.text == "load refused: requires ZERO_TORQUE, DAMPING or STANDBY, mode is LOCOMOTION"
        assert session.intake.ask("damp", LONG).granted
        ticks, events = quit_and_replay(session, capfd)
    (loaded,) = (event for event in events if event.kind is EventKind.POLICY)
    before = [tick for tick in ticks if float(tick.input.state.time) <= loaded.time]
    assert before[-1].output.control_mode.mode is Mode.STANDBY
    assert all(tick.output.policy_step is None for tick in before)
    assert any(tick.output.policy_step is not None for tick in ticks)
    assert [tick.index for tick in ticks] == list(range(len(ticks)))
    summary = json.loads((folder / "s.json").read_text(encoding="utf-8"))
    assert summary["policy"].endswith("lite_tracking.onnx")
    assert summary["motion"].endswith("circle.mcap")
    assert summary["tracking"]["samples"] > 0


@pytest.mark.slow
def test_a_policy_that_walks_takes_a_velocity_from_when_it_is_loaded(folder, capfd, run):
    """And a branch, and the same policy again, begin with what was loaded."""
    with playing(folder, "--policy", "none", "--pace", "realtime", "--robot", "lite_biped") as session:
        session.stand()
        assert not session.tick()["extern"] or "velocity_command" not in str(session.tick()["extern"])
        assert session.intake.load("lite_biped_velocity", command="0.3,0,0").granted
        session.until(lambda: "velocity_command" in str(session.tick()["extern"]))
        session.walk()

        def owns():  # for as long as it goes on sending
            session.intake.velocity(0.1, 0.0, 0.0, deliberate=True)
            return str(session.feed.status()["owners"].get("velocity")).startswith("test ")

        session.until(owns)
        assert session.intake.ask("damp", LONG).granted
        _, events = quit_and_replay(session, capfd)
    (loaded,) = (event for event in events if event.kind is EventKind.POLICY)
    (folder / "r.mcap").rename(folder / "run.mcap")
    assert run("--again", "run.mcap", "--policy-seconds", "1").summary["policy"].endswith("lite_biped_velocity.onnx")
    branch = run("--branch", f"run.mcap@{loaded.time + 0.1:g}", "--duration", "2")
    assert (branch.status, branch.err) == (0, "")
    assert "LOCOMOTION" in branch.modes
    early = run("--branch", f"run.mcap@{loaded.time - 0.1:g}", record=False)
    assert early.err == "error: --branch: 'run.mcap' has no policy at that time; name one with --policy\n"


def test_a_run_without_a_policy_stands_up(run, quick):
    result = run("--policy", "none", "--robot", quick, "--duration", "3", "--pace", "fast", "--video", "none")
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "DAMPING"]
    assert result.summary["policy"] is None
