"""The fixture that fails a test which leaves something open, tried on tests that do."""

import subprocess
import sys
from pathlib import Path

LEAKY = """
import socket, threading
import can

kept = []

def test_tidy(tmp_path):
    thread = threading.Thread(target=lambda: None)
    thread.start()
    with open(tmp_path / "a", "w"), can.Bus(interface="virtual", channel="tidy"):
        pass

def test_thread():
    kept.append(threading.Event())
    threading.Thread(target=kept[-1].wait, daemon=True, name="straggler").start()

def test_file(tmp_path):
    kept.append(open(tmp_path / "forgotten.txt", "w"))

def test_socket():
    kept.append(socket.socket())

def test_bus():
    kept.append(can.Bus(interface="virtual", channel="forgotten_bus"))

def test_log():
    with open("MUJOCO_LOG.TXT", "w") as file:
        file.write("WARNING: unstable")
"""


def test_leaks_are_found_and_named(tmp_path):
    conftest = Path(__file__).with_name("conftest.py").read_text(encoding="utf-8")
    (tmp_path / "conftest.py").write_text(conftest.replace("_PATIENCE = 2.0", "_PATIENCE = 0.05"), encoding="utf-8")
    (tmp_path / "test_leaky.py").write_text(LEAKY, encoding="utf-8")
    options = ["-q", "-p", "no:cacheprovider", "-W", "ignore::ResourceWarning", "--tb=short"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert "6 passed, 5 errors" in done.stdout
    assert "left open: thread 'straggler'" in done.stdout
    assert "forgotten.txt" in done.stdout
    assert "left open: file socket:" in done.stdout
    assert "left open: bus 'forgotten_bus'" in done.stdout
    assert f"left behind {tmp_path / 'MUJOCO_LOG.TXT'}: WARNING: unstable" in done.stdout
    assert "ERROR at teardown of test_tidy" not in done.stdout
