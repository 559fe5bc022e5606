"""`play --hardware` as a program, in real time, on emulated motors: from the first check to the last frame."""

import json
import subprocess
import sys
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.messages import Mode
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

LITE = load_robot("lite")
SCRIPT = "hold 0.5; damp; hold 0.5; load_a; wait; start_locomotion; hold 8; damp; hold 1"
COURSE = [Mode.ZERO_TORQUE, Mode.DAMPING, Mode.STANDBY, Mode.LOCOMOTION, Mode.DAMPING]
PLAY = """
import functools, runpy
from humanoid_sim.play import hardware_robot
events = open("events.txt", "w", buffering=1)
note = lambda time, text: print(text, file=events)
hardware_robot.MockServer = functools.partial(hardware_robot.MockServer, log=note)
runpy.run_module("humanoid_sim.play", run_name="__main__", alter_sys=True)
"""
"""`python -m humanoid_sim.play`, whose motors write down what becomes of them."""
TRIES, STANDSTILL = 3, 0.1  # s without a processor, of loop or motors, after which the robot is damped, rightly


def play(folder):
    """Run; returns the ticks, what each motor went through, and s that loop or motors stood still."""
    folder.mkdir()
    options = ["--hardware", "virtual:mock", "--allow-script", "--script", SCRIPT, "--policy", "lite_tracking"]
    program = [sys.executable, "-c", PLAY, *options, "--viewer", "none", "--html", "none", "--record", "r.mcap"]
    program += ["--summary", "s.json"]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=False)
    printed = done.stdout + done.stderr
    assert (folder / "r.mcap").exists(), printed
    recording, motors = open_recording(folder / "r.mcap"), {name: [] for name in LITE.joint_names}
    ticks = list(recording.ticks())
    assert recording.is_complete
    for line in Path(folder, "events.txt").read_text(encoding="utf-8").splitlines():
        joint, _, text = line.partition(": ")
        motors[joint].append(text)
    gaps = np.diff([float(tick.input.state.time) for tick in ticks])
    summary = json.loads(Path(folder, "s.json").read_text(encoding="utf-8"))
    return ticks, motors, max(gaps.max(), summary["hardware"]["emulation_stood_still"])


def test_a_walk_through_the_modes_on_emulated_motors_in_real_time(tmp_path, runtime):
    for attempt in range(TRIES):
        folder = tmp_path / str(attempt)
        ticks, motors, stood_still = play(folder)
        modes = [mode for mode, _ in groupby(tick.output.control_mode.mode for tick in ticks)]
        assert modes[-1] is Mode.DAMPING
        assert {events[-1] for events in motors.values()} == {"disabled"}
        assert all("enabled" in events for events in motors.values())
        assert all(np.isfinite(tick.input.state.joint_position).all() for tick in ticks)
        replay = [sys.executable, "-m", "humanoid_sim.replay", "r.mcap"]
        repeated = subprocess.run(replay, cwd=folder, capture_output=True, text=True, check=False)
        assert "bit for bit identical" in repeated.stdout, repeated.stderr
        if modes == COURSE:
            break
        assert stood_still > STANDSTILL, "damped early, and nothing of the machine's explains it"
    else:
        pytest.skip(f"in each of {TRIES} runs the machine gave loop or motors no processor for over {STANDSTILL} s")
    standing = [tick for tick in ticks if tick.output.control_mode.mode is Mode.STANDBY][-1]
    pose = LITE.standby_controller_a.pose_segments[-1]
    assert np.abs(standing.input.state.joint_position - pose).max() < 0.1
