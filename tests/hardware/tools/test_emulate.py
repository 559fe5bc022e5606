"""`python -m humanoid_sim.hardware emulate`."""

import re
import threading
import time

CHANNEL = "udp_multicast:239.74.163.62"


def test_it_says_what_happens_and_ends_with_a_summary(run):
    faults = ("--fault", "over_temperature:14@0.05", "--fault", "silent@0.1")
    status, out, err = run("emulate", "--channel", CHANNEL, *faults, "--duration", "0.3")
    assert (status, err) == (0, "")
    assert out.startswith(f"14 motors of lite on {CHANNEL}; ")
    assert re.search(r"0\.05\d s  left_elbow_pitch: motor_overtemperature", out)
    assert "0.100 s  fault: silent@0.1" in out
    assert re.search(r": \d+ frames$", out, re.MULTILINE)


def test_a_piano_s_keys_are_played_on_a_fifo(run, tmp_path):
    fifo, found = tmp_path / "keys", []

    def listen():
        while not fifo.exists():
            time.sleep(0.01)
        with open(fifo, "rb") as stream:
            found.append(stream.read())

    listener = threading.Thread(target=listen)
    listener.start()
    options = ("--channel", CHANNEL, "--robot", "lite_piano", "--quiet", "--duration", "0.6")
    status, _, err = run("emulate", *options, "--midi", str(fifo))
    listener.join()
    assert (status, err) == (0, "")
    assert found[0].count(b"\xfe") >= 2, "active sensing"
    assert not fifo.exists()
    status, _, err = run("emulate", "--channel", CHANNEL, "--midi", str(fifo))
    assert (status, err) == (2, f"error: --midi: is '{fifo}', but lite has no piano; lite_piano has one\n")


def test_a_calibration_assembles_the_motors(run, tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text("left_elbow_pitch: {id: 14, direction: -1, homing_offset: 0.5}\n")
    status, _, err = run("emulate", "--channel", CHANNEL, "--calibration", str(path), "--duration", "0.1")
    assert (status, err) == (0, "")
    status, _, err = run("emulate", "--channel", CHANNEL, "--calibration", str(tmp_path / "none.yaml"))
    assert status == 2
    assert "none.yaml" in err
