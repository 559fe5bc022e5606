"""`play` in a process of its own and motors in this one, over UDP multicast: killed in mid-motion, or started twice."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest
from waiting import until

from humanoid_sim import replay
from humanoid_sim.cli import run_program
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.messages import Mode
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads

pytestmark = pytest.mark.soak

CAN_TIMEOUT = 0.1
"""s, which the adapter writes into the motors."""
SLACK = 0.05
"""s for the last command to be on its way, and for this process to note what it is told."""


class Told:
    """What the motors tell, with the time of this process."""

    def __init__(self):
        self.lines = []

    def __call__(self, _, text):
        self.lines.append((time.monotonic(), text))

    def times_of(self, text, after=0.0):
        return [at for at, line in self.lines if at >= after and line.endswith(f": {text}")]


@pytest.fixture
def robot(make_robot):
    """Stands with its arms stretched out to the sides, from where they fall furthest."""

    def stretch(document):
        for pose in ("a", "b"):
            document[f"standby_controller_{pose}"]["pose_segments"] = [[0.0] * 14, [0.0] * 14]
            document[f"standby_controller_{pose}"]["segment_durations"] = [1.0, 0.2]

    return make_robot(change=stretch)


@pytest.fixture
def channel(calibrate):
    """A multicast group that no other test uses, and a calibration beside it."""
    calibrate()
    return f"udp_multicast:239.74.{os.getpid() % 250}.{time.monotonic_ns() // 1000 % 250}"


@contextmanager
def playing(robot, channel, folder, record="r.mcap"):
    script = "damp; hold 0.3; load_a; wait; start_locomotion; hold 100"
    options = ("--robot", robot, "--hardware", channel, "--yes", "--allow-script", "--script", script)
    output = ("--policy", "placeholder", "--viewer", "none", "--record", record, "--overwrite")
    with subprocess.Popen(
        [sys.executable, "-m", "humanoid_sim.play", *options, *output],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def emulated(robot, channel, told):
    """Motors that other programs on this computer do not hold up."""
    with punctual_threads(behind=10):
        motors = VirtualMotors(load_robot(robot), [channel], told=told)
    with motors:
        yield motors


def wait_for(process, text):
    seen = ""
    for line in process.stdout:
        seen += line
        if text in line:
            return
    raise AssertionError(f"{text!r} never came:\n{seen}")


def test_motors_whose_host_is_killed_stop_by_themselves_and_the_arms_sink(robot, channel, folder):
    told = Told()
    with emulated(robot, channel, told) as motors:
        with playing(robot, channel, folder) as process:
            wait_for(process, "STANDBY → LOCOMOTION")
            time.sleep(0.7)
            held = motors.truth
            assert len(told.times_of("enabled")) >= 14  # more where an answer was late and the question repeated
            assert np.abs(held.joint_effort).max() > 1.0
            process.send_signal(signal.SIGKILL)
            killed = time.monotonic()
            process.wait()
        until(lambda: len(told.times_of("stopped, in reset mode", killed)) == 14, 2.0)
        stopped = [at - killed for at in told.times_of("stopped, in reset mode", killed)]
        print(f"\nmotors left run mode {1e3 * min(stopped):.0f} to {1e3 * max(stopped):.0f} ms after the kill")
        assert CAN_TIMEOUT - 0.03 <= min(stopped) <= max(stopped) <= CAN_TIMEOUT + SLACK
        time.sleep(0.05)
        assert not np.abs(motors.truth.joint_effort).any()  # in reset mode a motor is free
        time.sleep(0.6)
        roll = load_robot(robot).joint_names.index("left_shoulder_roll")
        assert held.joint_position[roll] - motors.truth.joint_position[roll] > 0.5  # the arm swings down
    recording = open_recording(folder / "r.mcap")
    ticks = list(recording.ticks())
    assert not recording.is_complete
    assert ticks[-1].output.control_mode.mode is Mode.LOCOMOTION
    assert run_program(replay.main, [str(folder / "r.mcap")]) == 0


def test_the_second_of_two_sessions_on_one_channel_refuses_and_the_first_goes_on(robot, channel, folder):
    told = Told()
    with emulated(robot, channel, told) as motors, playing(robot, channel, folder) as first:
        wait_for(first, "STANDBY → LOCOMOTION")
        with playing(robot, channel, folder, "second.mcap") as second:
            out, _ = second.communicate(timeout=30.0)
        assert second.returncode == 2
        assert f"problem {channel}  is in use by another session (process {first.pid}, " in out
        assert out.splitlines()[-1] == "error: lite: not enabled, 1 problem"
        assert told.times_of("stopped, in reset mode") == []
        assert np.abs(motors.truth.joint_effort).max() > 1.0
        first.send_signal(signal.SIGINT)
        reader = threading.Thread(target=first.communicate)
        reader.start()
        reader.join(30.0)
        assert first.returncode == 130
        assert len(told.times_of("stopped, in reset mode")) == 14  # disabled by the session that ends
