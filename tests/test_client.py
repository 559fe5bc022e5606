"""The client as others use it: one file, in any Python that has NumPy."""

import shutil
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import humanoid_sim.client
from humanoid_sim.client import ask_sessions
from humanoid_sim.messages import Intent

FILE = Path(humanoid_sim.client.__file__)

PROGRAM = """
import sys
sys.path.append(sys.argv[1])
import humanoid_client as client
assert "numpy" not in sys.modules
with client.Feed(client.find_session()) as feed, client.Intake(feed.session, "outside") as intake:
    print(flush=True)
    tick = feed.decode(feed.wait(0, 10.0))
    print(tick["mode"], tick["joint_position"].tolist(), feed.joint_names)
    token = intake.post("load_a")
    print(intake.velocity(0.25, 0, 0, deliberate=True), flush=True)
    sys.stdin.readline()
    print(intake.answer(token, 5.0).granted)
assert "humanoid_sim" not in sys.modules
"""


def test_the_one_file_works_by_itself_in_an_isolated_python(local, tmp_path):
    shutil.copy(FILE, tmp_path / "humanoid_client.py")
    local.tick(Intent.DAMP)
    with subprocess.Popen(
        [sys.executable, "-I", "-c", PROGRAM, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdout.readline() == "\n"
        local.tick()
        assert program.stdout.readline() == "1 [0.4, 0.5, 0.6] ('shoulder', 'elbow', 'wrist')\n"
        assert program.stdout.readline() == "True\n"
        record = local.tick()
        assert program.communicate("\n")[0] == "True\n"
    assert record.input.intents == (Intent.LOAD_A,)
    assert record.input.state.extern["velocity_command"].value.tolist() == [0.25, 0.0, 0.0]


def test_a_damp_for_all_reaches_a_session_behind_one_that_is_suspended(local, tmp_path, monkeypatch):
    """What was sent to that one before fills its socket, and whoever sends more must wait."""
    works = local.info
    suspended = replace(works, process=1, path=tmp_path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as intents, socket.socket(socket.AF_UNIX, 2) as sender:
        intents.bind(str(tmp_path / "intents"))
        (tmp_path / "data").symlink_to(local.registration.path / "data")
        sender.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                sender.sendto(b"damp", str(tmp_path / "intents"))
        monkeypatch.setattr(humanoid_sim.client, "running_sessions", lambda: [suspended, works])
        answers = []

        def ask():
            for session, answer in ask_sessions("damp", None, producer="mode", timeout=0.01):
                answers.append((session.process, answer))
                intents.recv(100)  # room for the other

        thread = threading.Thread(target=ask)
        thread.start()
        while not answers:
            local.tick()
        thread.join()
    assert answers[0][0] == works.process, "before the other's socket takes anything"
