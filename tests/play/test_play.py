"""End to end: options in, exit status, tables and files out."""

import io
import json
import subprocess
import sys

import pytest

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.play import run as run_module
from humanoid_sim.robots.description import load_robot

PLACEHOLDER = ("--policy", "placeholder")
WALK = "damp; hold 0.1; load_a; wait; start_locomotion; hold 1; damp; hold 0.2"


def test_without_options_the_sample_policy_is_walked_up_and_down_again(run):
    result = run()
    assert (result.status, result.err) == (0, "")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    intents = ("DAMP", "LOAD_A", "START_LOCOMOTION", "DAMP")
    assert result.reasons == ["started", *(f"{intent} requested" for intent in intents)]
    summary = result.summary
    assert summary["policy"].endswith("lite_tracking.onnx")
    assert summary["motion"].endswith("wave.mcap")
    assert (summary["faults"], summary["refusals"], summary["safety"]) == ([], [], [])
    assert summary["loop"]["ticks"] == len(result.ticks)
    assert summary["duration"] == pytest.approx(len(result.ticks) * 0.005)
    frames = [tick.output.policy_step.frame for tick in result.ticks if tick.output.policy_step]
    assert summary["inferences"] == len(frames)
    tracking = summary["tracking"]
    assert tracking["samples"] == max(frames) + 1 < len(frames)  # the last frame is held, and counts once
    assert 0.0 < tracking["errors"]["hand_position_error"]["rms"] <= 0.03
    assert "Tracking" in result.out
    # The end: a second in DAMPING that the script asks for, then until the joints are at rest.
    assert summary["modes"][-1]["end"] - summary["modes"][-1]["start"] >= 1.5
    assert [event.text for event in result.events] == ["ending: script finished"]
    assert sorted(path.name for path in result.folder.iterdir()) == ["r.mcap", "s.json"]


def test_a_run_too_short_for_the_policy_says_that_it_did_not_run(run, quick):
    assert "the policy did not run" in run("--robot", quick, "--duration", "0.5").out


def test_another_policy_is_selected_between_two_motions_and_the_run_replays_as_it_was(run, quick):
    script = WALK.replace("start", "policy placeholder; start") + "; policy placeholder; load_a; wait; start_locomotion"
    policies = ("--policy", "lite_tracking", *PLACEHOLDER)
    result = run("--robot", quick, "--script", f"{script}; hold 0.5; damp", *policies)
    assert result.status == 0
    assert [item["message"].split(":")[0] for item in result.summary["refusals"]] == ["policy placeholder refused"]
    messages = {tick.output.control_mode.status_message for tick in result.ticks}
    for name in ("lite_tracking", "placeholder"):
        assert f"START_LOCOMOTION requested, policy {name}" in messages
    widths = [len(step.observation) for tick in result.ticks if (step := tick.output.policy_step)]
    assert len(set(widths)) == 2
    assert [widths[0], widths[-1]] == list(dict.fromkeys(widths))
    assert run_program(replay.main, ["r.mcap"]) == 0
    with pytest.raises(InputError, match="several policies"):
        replay.main(["r.mcap", "--policy", "lite_tracking"])


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_the_placeholder_holds_the_pose_that_it_starts_from_and_says_so(run, make_robot, name):
    path = make_robot(name)
    result = run("--robot", path, "--duration", "3.3", *PLACEHOLDER)
    assert result.status == 0
    assert "PLACEHOLDER POLICY: no network runs" in result.out.replace("\n", " ")
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    assert result.summary["reason"] == "duration of 3.3 s reached"
    assert result.summary["motion"] is result.summary["tracking"] is None
    pose = load_robot(path).standby_controller_a.pose_segments[-1]
    running = [tick for tick in result.ticks if tick.output.control_mode.mode is Mode.LOCOMOTION]
    assert len(running) > 100
    for tick in running:
        assert tick.output.command.position.tolist() == list(pose)
    step = next(tick.output.policy_step for tick in running if tick.output.policy_step)
    assert step.action.tolist() == [0.0] * len(pose)


def test_a_script_drives_the_fsm_and_refusals_are_shown(run, quick):
    script = "load_a; damp; start_locomotion; load_b; wait; load_a; hold 0.1; damp; quit"
    result = run("--robot", quick, "--script", script, *PLACEHOLDER)
    assert result.status == 0
    assert result.modes == ["ZERO_TORQUE", "DAMPING", "STANDBY", "DAMPING"]
    assert result.summary["modes"][2]["controller"] == "standby_controller_b"
    assert result.summary["reason"] == "QUIT"
    assert [item["message"] for item in result.summary["refusals"]] == [
        "LOAD_A refused: requires DAMPING, mode is ZERO_TORQUE",
        "START_LOCOMOTION refused: requires finished STANDBY, mode is DAMPING",
        "LOAD_A refused: requires DAMPING, mode is STANDBY",
    ]
    assert "LOAD_A refused: requires DAMPING, mode is STANDBY" in result.out


def test_files_that_exist_are_replaced_only_when_asked(run, quick, folder):
    for name in ("kept.mcap", "kept.json"):
        (folder / name).write_bytes(b"mine")
    options = ("--robot", quick, "--duration", "0.1", *PLACEHOLDER, "--summary", "kept.json")
    refused = run(*options, record=False)
    assert refused.err == "error: --summary: 'kept.json' exists; choose another name, or add --overwrite\n"
    assert (folder / "kept.json").read_bytes() == b"mine"
    assert run(*options, "--record", "kept.mcap", "--overwrite", record=False).status == 0
    assert json.loads((folder / "kept.json").read_bytes())["recording"] == "kept.mcap"
    assert (folder / "kept.mcap").read_bytes()[:5] == b"\x89MCAP"
    assert sorted(path.name for path in folder.iterdir()) == ["kept.json", "kept.mcap"]


def test_a_file_that_cannot_be_written_in_the_end_spares_the_others(run, quick, folder, monkeypatch):
    def full(*_):
        raise InputError("s.json: cannot be written: No space left on device")

    monkeypatch.setattr(run_module, "write_summary", full)
    result = run("--robot", quick, "--duration", "0.1", "--viewer", "auto", *PLACEHOLDER)
    assert result.status == 1
    assert "failed: s.json: cannot be written: No space left on device" in result.out
    assert "html       r.html   " in result.out
    assert (folder / "r.html").is_file(), "nobody watches: the page lies beside the recording"
    assert len(result.ticks) > 20


def test_a_terminal_that_goes_in_mid_run_leaves_the_files_of_the_run(run, quick, monkeypatch):
    class Gone(io.StringIO):
        def write(self, text):
            if "DAMPING" in text or "Input/output" in self.getvalue():
                super().write("Input/output error")
                raise OSError("Input/output error")
            return super().write(text)

    monkeypatch.setattr(sys, "stdout", Gone())
    result = run("--robot", quick, "--script", "damp; hold 0.5", *PLACEHOLDER)
    sys.stdout.close()  # where nothing is printed any more
    assert (result.status, result.err) == (1, "")
    assert result.summary["reason"] == "script finished"


def test_a_simulation_that_becomes_unstable_is_no_success(run, make_robot):
    def throw(document):
        joint = document["joints"][0]
        del joint["motor"]  # none is so strong
        joint["effort_limit"] = 1e12
        document["standby_controller_a"]["target_stiffness"][0] = 9e5
        document["guards"] = {"following": None, "limit": None, "speed": None}  # which would damp it in time

    result = run("--robot", make_robot(change=throw), "--script", "damp; load_a; hold 1", *PLACEHOLDER)
    assert result.status == 1
    assert result.modes[-1] == "DAMPING"  # whatever the readings are: some are absurd, but finite
    assert "simulation unstable" in result.reasons[-1]
    assert "simulation unstable" in result.summary["safety"][0]["message"]


PROGRAM = """
import sys
from humanoid_sim.play import main
from humanoid_sim.session.session import Session

tick, known = Session.tick, set()

def watched(self, *intents):
    before = set(known)
    tick(self, *intents)
    known.update(sys.modules)
    if before and known - before:
        print("loaded in a tick:", *sorted(known - before))

Session.tick = watched
sys.exit(main(sys.argv[1:]))
"""
MODES = "hold 0.1; damp; hold 0.1; load_a; wait; start_locomotion; hold 0.3; damp; hold 0.1; load_b; wait; start_remote"


def test_no_tick_of_any_mode_loads_a_module(folder, quick):
    """An import in a tick takes as long as several ticks."""
    script = ("--script", f"{MODES}; hold 0.1; damp; hold 0.1", "--viewer", "none", "--record", "r.mcap")
    command = [sys.executable, "-c", PROGRAM, "--robot", quick, "--pace", "fast", *script]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert "LOCOMOTION → DAMPING" in run.stdout, run.stderr
    assert "→ REMOTE" in run.stdout
    assert "loaded in a tick" not in run.stdout
