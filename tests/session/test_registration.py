import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from local_session import LocalSession

from humanoid_sim.client import Intake, SessionError, find_session, running_sessions
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.session.registration import Registration

KILLED = """
import os, signal, sys
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.registration import Registration
from humanoid_sim.messages import SessionHeader
registration = Registration()
feed = FeedWriter(SessionHeader("r", ("a",), 0.02, 0))
registration.intents.touch(), registration.data.touch()
registration.register(robot="r", policy="p", hardware="can0", feed=feed.path)
print(os.getpid(), feed.path, flush=True)
if sys.argv[1] == "kill":
    os.kill(os.getpid(), signal.SIGKILL)
sys.stdin.readline()
registration.close()
feed.close()
"""


@pytest.fixture
def folder(runtime):
    return runtime / f"humanoid_sim-{os.getuid()}"


def test_a_session_says_what_it_is_while_it_runs(local, folder):
    (info,) = running_sessions()
    assert (info.process, info.robot, info.policy, info.folder) == (os.getpid(), "three", "p.onnx", os.getcwd())
    assert str(info) == f"session {os.getpid()} (three, policy p.onnx, started in {os.getcwd()})"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert Path(info.feed).stat().st_mode & 0o777 == 0o600
    assert info.is_running()
    local.stack.close()
    assert not info.is_running()
    assert running_sessions() == []
    assert list(folder.iterdir()) == []
    assert not Path(info.feed).exists()


def test_what_a_killed_session_left_is_no_session_and_the_next_one_removes_it(folder):
    out = subprocess.run([sys.executable, "-c", KILLED, "kill"], stdout=subprocess.PIPE, text=True, check=False).stdout
    process, _ = out.split()
    assert (folder / f"{process}.session").exists()
    # The id belongs to somebody else now, who holds no lock.
    (folder / f"{process}.session").rename(folder / f"{os.getppid()}.session")
    assert running_sessions() == []
    (folder / f"{process}.intents").rename(folder / f"{os.getppid()}.intents")
    (folder / f"{process}.data").rename(folder / f"{os.getppid()}.data")
    (folder / f"{process}-0.reply").touch()
    (folder / "strange.session").write_text('{"feed": "/etc/passwd"}')
    Registration()
    assert list(folder.iterdir()) == []
    assert Path("/etc/passwd").exists()


def test_with_several_sessions_one_must_be_named(local):
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, "stay"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        other.stdout.readline()
        assert [info.process for info in running_sessions()] == sorted((os.getpid(), other.pid))
        with pytest.raises(SessionError, match="--session: is needed where several sessions run; running: session "):
            find_session()
        assert str(find_session(other.pid)).startswith(f"session {other.pid} (r on can0, policy p, started in ")
        other.communicate("\n")
    assert find_session().process == os.getpid()
    with pytest.raises(SessionError, match=f"--session: {other.pid} is not a running session; running: session "):
        find_session(other.pid)


def test_a_process_has_one_session(local):
    with pytest.raises(InputError, match="another session has this process id"):
        Registration()


def test_a_file_of_another_version_is_passed_over(local):
    path = local.registration.path
    told = json.loads(path.read_text())
    path.write_text(json.dumps({**told, "process": "x"}))
    assert running_sessions() == []


def test_a_folder_that_others_may_enter_is_refused(folder):
    folder.mkdir(mode=0o755)
    folder.chmod(0o755)
    with pytest.raises(InputError, match="only its user can enter"):
        Registration()
    with pytest.raises(SessionError, match="only its user can enter"):
        running_sessions()


def test_a_runtime_folder_that_is_not_there_is_no_obstacle(monkeypatch, runtime):
    monkeypatch.setattr("tempfile.tempdir", str(runtime))
    for value in (str(runtime / "gone"), "relative", ""):
        monkeypatch.setenv("XDG_RUNTIME_DIR", value)
        Registration()
    assert (runtime / f"humanoid_sim-{os.getuid()}").is_dir()


def test_no_session_starts_whose_folder_leaves_no_room_for_a_clients_socket(monkeypatch, runtime):
    name = f"humanoid_sim-{os.getuid()}"
    fits = runtime / ("x" * (88 - len(f"{runtime}//{name}")))
    longer = fits.with_name(f"{fits.name}x")
    fits.mkdir()
    longer.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(longer))
    with pytest.raises(InputError, match=f"{longer}/{name}: 89 bytes are too long for a session's sockets, at most 88"):
        Registration()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(fits))
    local = LocalSession()
    with local.stack, Intake(find_session(), "somebody") as intake:
        intake.post("damp")
        assert local.tick().output.control_mode.mode is Mode.DAMPING


def test_a_folder_that_cannot_be_made_is_one_line(runtime):
    (runtime / f"humanoid_sim-{os.getuid()}").touch()
    with pytest.raises(InputError, match="is not a folder that only its user can enter"):
        Registration()
