"""Gravity compensation, and its example beside a whole `play` with its DDS bridge; tests/integration kills it."""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from dds_bridge import free_domain
from script_files import load_script

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed (dds)")

from humanoid_sim.gravity import gravity_command
from humanoid_sim.messages import Mode
from humanoid_sim.mit import mit_torque
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics, GravityTorque

EXAMPLE = Path(__file__).parents[2] / "examples" / "gravity_compensation.py"
LITE = load_robot("lite")
_SETTLED = 0.5
"""s after which the arms are at rest."""


@pytest.fixture(scope="module")
def example():
    return load_script(EXAMPLE)


@pytest.mark.parametrize("form", ["effort", "pd"])
def test_both_forms_command_gravitys_torque_at_the_pose_and_no_more(example, form):
    pose = LITE.initial_position + np.full(14, 0.1)
    gravity = GravityTorque(LITE)(pose)
    assert np.abs(gravity).max() > 0.5
    for command in (gravity_command(LITE, pose, gravity, form), example.command(LITE, pose, gravity, form, 1.0)):
        torque = mit_torque(command, pose, np.zeros(14), LITE.effort_limit)
        np.testing.assert_allclose(torque, gravity, atol=1e-9)
        assert not command.velocity.any()
        assert (command.stiffness.any(), command.effort.any()) == (form == "pd", form == "effort")
        assert (command.damping > 0.0).all()


@contextmanager
def running(*command):
    with subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as one:
        try:
            yield one
        finally:
            one.kill()


def line_with(process, text):
    """The next line of a program that holds a text."""
    for line in process.stdout:
        if text in line:
            return line
    raise AssertionError(f"ended without: {text}")


@pytest.mark.soak
def test_the_arms_are_held_in_both_forms(tmp_path, monkeypatch, runtime):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(free_domain()))
    record = tmp_path / "run.mcap"
    script = "damp; load_b; wait; start_remote; hold 600"
    options = ("--dds", "--pace", "realtime", "--viewer", "none", "--html", "none", "--record", str(record))
    with running("-m", "humanoid_sim.play", *options, "--script", script) as play:
        line_with(play, "dds: domain ")
        for form in ("effort", "pd"):
            with running(str(EXAMPLE), "--form", form) as client:
                line_with(client, "REMOTE: holding")
                time.sleep(8.0)
                client.terminate()
                assert client.wait(60.0) == 0
        play.send_signal(signal.SIGINT)
        play.communicate(timeout=60.0)
    remote = [tick for tick in open_recording(record).ticks() if tick.output.control_mode.mode is Mode.REMOTE]
    for field in ("effort", "stiffness"):
        held = [tick for tick in remote if getattr(tick.output.command, field).any()]
        settled = [tick for tick in held if tick.input.state.time >= held[0].input.state.time + _SETTLED]
        positions, _ = ForwardKinematics(LITE)(np.array([tick.input.state.joint_position for tick in settled[::10]]))
        drift = float(np.linalg.norm(positions - positions[0], axis=-1).max())
        print(f"{field}: the hands drift {1e6 * drift:.0f} um in {len(settled)} ticks")
        assert drift < 0.001
        assert len(settled) > 200
