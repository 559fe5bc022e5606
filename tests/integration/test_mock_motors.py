"""`play --hardware` as a program, in real time, on emulated motors: from the first check to the last frame."""

import json
import subprocess
import sys
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
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
STANDSTILL, SILENCE = 0.1, 0.2
"""s. A loop that rests longer than the motors' CAN timeout damps the robot, and so do motors that are silent for longer
than that: rightly, even where both only got no processor."""
TRIES = 3


@dataclass
class Run:
    folder: Path
    status: int
    said: str

    @cached_property
    def summary(self):
        return json.loads((self.folder / "s.json").read_text(encoding="utf-8"))

    @cached_property
    def ticks(self):
        recording = open_recording(self.folder / "r.mcap")
        ticks = list(recording.ticks())
        assert recording.is_complete
        return ticks

    @property
    def course(self):
        modes = [tick.output.control_mode.mode for tick in self.ticks]
        return modes[:1] + [mode for before, mode in pairwise(modes) if mode is not before]

    @property
    def motors(self):
        """By joint, what its motor went through."""
        found = {name: [] for name in LITE.joint_names}
        for line in (self.folder / "events.txt").read_text(encoding="utf-8").splitlines():
            joint, _, text = line.partition(": ")
            found[joint].append(text)
        return found

    @property
    def was_starved(self):
        """Whether it ended early, and the machine had given loop or motors no processor for so long that it must."""
        times = [float(tick.input.state.time) for tick in self.ticks]
        longest = max(late - early for early, late in pairwise(times))
        stood = self.summary["hardware"]["emulation_stood_still"]
        is_whole = self.status == 0 and self.course == COURSE
        return not is_whole and (longest > STANDSTILL or stood > SILENCE)


def play(folder):
    folder.mkdir()
    options = ["--hardware", "virtual:mock", "--allow-script", "--script", SCRIPT, "--policy", "lite_tracking"]
    results = ["--viewer", "none", "--html", "none", "--record", "r.mcap", "--summary", "s.json"]
    program = [sys.executable, "-c", PLAY, *options, *results]
    done = subprocess.run(program, cwd=folder, capture_output=True, text=True, check=False)
    return Run(folder, done.returncode, done.stdout + done.stderr)


def check_what_always_holds(run):
    """However busy the machine: damped at the end, motors off, joints measured, and a recording that repeats."""
    assert run.ticks[-1].output.control_mode.mode is Mode.DAMPING
    assert {events[-1] for events in run.motors.values()} == {"disabled"}
    assert all("enabled" in events for events in run.motors.values())
    for tick in run.ticks:
        assert np.isfinite(tick.input.state.joint_age).all()
        assert np.isfinite(tick.input.state.joint_position).all()
    replay = [sys.executable, "-m", "humanoid_sim.replay", "r.mcap"]
    repeated = subprocess.run(replay, cwd=run.folder, capture_output=True, text=True, check=False)
    assert repeated.returncode == 0, repeated.stdout + repeated.stderr
    assert "bit for bit identical" in repeated.stdout


def test_a_walk_through_the_modes_on_emulated_motors_in_real_time(tmp_path, runtime):
    for attempt in range(TRIES):
        run = play(tmp_path / str(attempt))
        assert (run.folder / "r.mcap").exists(), run.said
        check_what_always_holds(run)
        if not run.was_starved:
            break
    else:
        pytest.skip(f"this machine stood still in each of {TRIES} runs, and each was damped, as it should be")
    assert (run.status, run.course) == (0, COURSE), run.said
    hardware = run.summary["hardware"]
    assert hardware["channels"][0]["received"] > 0
    standing = [tick for tick in run.ticks if tick.output.control_mode.mode is Mode.STANDBY][-1]
    pose = LITE.standby_controller_a.pose_segments[-1]
    assert np.abs(standing.input.state.joint_position - pose).max() < 0.1
    assert (
        run.summary["tracking"]["errors"]["hand_position_error"]["rms"] < 0.05
    )  # m; the arms follow the sample policy's motion
