"""`python -m humanoid_sim.hardware emulate`."""

import re
import signal
import time
from types import SimpleNamespace

from humanoid_sim.hardware.tools import emulate

CHANNEL = "udp_multicast:239.74.163.62"


def test_changes_of_motors_and_faults_are_printed_until_ctrl_c(run, tmp_path, monkeypatch):
    lines, wakes = [], []

    def keep(line, flush=True):
        lines.append(line)
        print(line)

    def interrupt(seconds):
        wakes.append(seconds)
        time.sleep(seconds)
        if len(wakes) == 400 or any("silent" in line for line in lines):
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(emulate, "print", keep, raising=False)
    monkeypatch.setattr(emulate, "time", SimpleNamespace(sleep=interrupt))
    path = tmp_path / "calibration.yaml"
    path.write_text("left_elbow_pitch: {id: 14, direction: -1, homing_offset: 0.5}\n")
    assembled = ("--calibration", str(path), "--firmware", "rs-02=0.2.3.32")
    faults = ("--fault", "over_temperature:left_elbow_pitch@0.01", "--fault", "silent@0.05")
    status, out, err = run("emulate", "--channel", CHANNEL, *faults, *assembled)
    assert (status, err) == (0, "")
    assert out.startswith(f"14 motors of lite on {CHANNEL}; ")
    assert re.search(r"0\.\d+ s  left_elbow_pitch: motor_overtemperature", out)
    assert "0.050 s  fault: silent of all" in out
