"""`python -m humanoid_sim.hardware emulate`."""

import os
import re
import signal
import subprocess
import sys

CHANNEL = "udp_multicast:239.74.163.62"


def test_changes_of_motors_and_faults_are_printed(run):
    faults = ("--fault", "over_temperature:left_elbow_pitch@0.05", "--fault", "silent@0.1")
    status, out, err = run("emulate", "--channel", CHANNEL, *faults, "--duration", "0.3")
    assert (status, err) == (0, "")
    assert out.startswith(f"14 motors of lite on {CHANNEL}; ")
    assert re.search(r"0\.05\d s  left_elbow_pitch: motor_overtemperature", out)
    assert "0.100 s  fault: silent of all" in out


def test_a_calibration_assembles_the_motors(run, tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text("left_elbow_pitch: {id: 14, direction: -1, homing_offset: 0.5}\n")
    status, _, err = run("emulate", "--channel", CHANNEL, "--calibration", str(path), "--duration", "0.1")
    assert (status, err) == (0, "")
    status, _, err = run("emulate", "--channel", CHANNEL, "--calibration", str(tmp_path / "none.yaml"))
    assert status == 2
    assert "none.yaml" in err


def test_a_burst_of_signals_ends_it():
    """As wrappers send them that pass a terminal's signal on."""
    words = [sys.executable, "-m", "humanoid_sim.hardware", "emulate", "--channel", CHANNEL, "--quiet"]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as emulation:
        emulation.stdout.readline()
        for i in range(400):
            if emulation.poll() is None:
                os.kill(emulation.pid, signal.SIGINT if i % 2 else signal.SIGTERM)
        assert emulation.wait(60.0) == 0
