import os
import subprocess
import sys
from pathlib import Path

import pytest

from humanoid_sim.client import SessionError, find_session, running_sessions
from humanoid_sim.errors import InputError
from humanoid_sim.session.registration import Registration

KILLED = """
import os, signal, sys
from humanoid_sim.session.registration import Registration
registration = Registration()
registration.register(robot="r", policy="p", hardware="can0")
print(registration.path, flush=True)
if sys.argv[1] == "kill":
    os.kill(os.getpid(), signal.SIGKILL)
sys.stdin.readline()
registration.close()
"""


def test_with_several_sessions_one_must_be_named(local):
    command = [sys.executable, "-c", KILLED, "stay"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        other.stdout.readline()
        assert [info.process for info in running_sessions()] == sorted((os.getpid(), other.pid))
        with pytest.raises(SessionError, match="--session: is needed where several sessions run; running: session "):
            find_session()
        assert str(find_session(other.pid)).startswith(f"session {other.pid} (r on can0, policy p, started in ")
        other.communicate("\n")
    assert find_session().process == os.getpid()
    with pytest.raises(SessionError, match=f"--session: {other.pid} is not a running session; running: session "):
        find_session(other.pid)


def test_a_folder_that_others_may_enter_is_refused(runtime):
    folder = runtime / f"humanoid_sim-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o755)
    with pytest.raises(InputError, match="only its user can enter"):
        Registration()
    with pytest.raises(SessionError, match="only its user can enter"):
        running_sessions()


def test_what_a_killed_session_left_is_no_session_and_the_next_one_removes_it(runtime):
    with subprocess.Popen([sys.executable, "-c", KILLED, "kill"], stdout=subprocess.PIPE, text=True) as killed:
        left = Path(killed.stdout.readline().strip())
    assert left.is_dir()
    assert running_sessions() == []
    registration = Registration()
    assert not left.exists()
    registration.close()
    assert not registration.path.exists()
