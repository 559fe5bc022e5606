from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rig

from humanoid_sim import mode
from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.robot import LoopbackRobot
from humanoid_sim.session.control_socket import ControlSocket, running_sessions, send_intent, send_reactivate
from humanoid_sim.session.reactivation import Answer, Reactivation


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / f"humanoid_sim-{os.getuid()}"


@pytest.fixture
def control() -> Iterator[ControlSocket]:
    socket = ControlSocket()
    yield socket
    socket.close()


def output() -> TickOutput:
    return rig.Run(rig.supervisor()).step(Intent.DAMP)


def serve(control: ControlSocket, ticks: int, work: Callable[[], None]) -> list[Intent]:
    """Poll in turn with the clients' work until it is done, as the loop would; the intents that came."""
    got: list[Intent] = []
    thread = threading.Thread(target=work)
    thread.start()
    tick = output()
    while thread.is_alive():
        got += control.poll(0.0, tick)
        thread.join(0.002)
    return got


def test_an_intent_reaches_the_session_and_its_answer_comes_back(control: ControlSocket) -> None:
    answers: list[Answer] = []
    got = serve(control, 100, lambda: answers.append(send_intent(os.getpid(), Intent.LOAD_A)))
    assert got == [Intent.LOAD_A]
    assert answers == [Answer(True, "DAMPING (damping_controller): DAMP requested")]


def test_a_refusal_is_told_apart_by_more_than_its_words(control: ControlSocket, folder: Path) -> None:
    refused = rig.Run(rig.supervisor()).step(Intent.LOAD_A)
    assert refused.refusals
    answers: list[Answer] = []
    thread = threading.Thread(target=lambda: answers.append(send_intent(os.getpid(), Intent.LOAD_A, timeout=5.0)))
    thread.start()
    while not control.poll(0.0, None):
        pass
    control.poll(0.0, refused)
    thread.join()
    assert [answer.granted for answer in answers] == [False]


def test_the_session_is_listed_while_it_runs(folder: Path) -> None:
    assert running_sessions() == []
    socket = ControlSocket()
    assert running_sessions() == [os.getpid()]
    assert folder.stat().st_mode & 0o777 == 0o700
    socket.close()
    assert running_sessions() == []
    assert list(folder.iterdir()) == []


def test_a_session_that_was_killed_is_forgotten(folder: Path) -> None:
    running_sessions()
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        ended.wait()
    (folder / f"{ended.pid}.session").touch()
    (folder / "strange.session").touch()
    assert running_sessions() == []
    assert list(folder.iterdir()) == []


def test_what_is_no_intent_is_ignored_and_a_flood_is_taken_in_pieces(control: ControlSocket, folder: Path) -> None:
    path = str(folder / f"{os.getpid()}.session")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        for word in (b"dampen", b"", b"\xff\xfe", b"x" * 1000, b"load_b"):
            client.sendto(word, path)
        assert list(control.poll(0.0, None)) == [Intent.LOAD_B]
        sent = 0
        for _ in range(100):
            try:
                client.sendto(b"damp", path)
            except BlockingIOError:
                break
            sent += 1
    got = [len(control.poll(0.0, None)) for _ in range(20)]
    assert sum(got) == sent > 0
    assert max(got) <= 16


def test_a_session_that_does_not_answer_or_does_not_run(control: ControlSocket) -> None:
    with pytest.raises(InputError, match=r"session \d+: did not answer within 0.05 s"):
        send_intent(os.getpid(), Intent.DAMP, timeout=0.05)
    with pytest.raises(InputError, match="session 1: cannot be reached: No such file"):
        send_intent(1, Intent.DAMP)


def test_closing_answers_whoever_still_waits() -> None:
    control = ControlSocket()
    answers: list[Answer] = []
    thread = threading.Thread(target=lambda: answers.append(send_intent(os.getpid(), Intent.QUIT, timeout=5.0)))
    thread.start()
    while not control.poll(0.0, None):
        pass
    control.close()
    thread.join()
    assert answers == [Answer(True, "the session has ended")]


def test_reactivate_is_answered_once_the_session_has_served_it(folder: Path) -> None:
    reactivation = Reactivation()
    control = ControlSocket(reactivation)
    answers: list[Answer] = []
    thread = threading.Thread(target=lambda: answers.append(send_reactivate(os.getpid(), timeout=5.0)))
    thread.start()
    while not reactivation.is_asked:
        assert control.poll(0.0, None) == []
    assert control.poll(0.02, None) == []
    assert answers == []
    told = reactivation.serve(LoopbackRobot(load_robot("lite")), Mode.DAMPING)
    control.poll(0.04, None)
    thread.join()
    control.close()
    assert answers == [Answer(True, told[0])]
    assert told[0] == "reactivated: the robot is verified and enabled afresh"


def test_a_folder_that_others_may_enter_is_refused(folder: Path) -> None:
    folder.mkdir(mode=0o755)
    folder.chmod(0o755)
    with pytest.raises(InputError, match="only its user can enter"):
        ControlSocket()


def test_a_runtime_folder_that_is_not_there_is_no_obstacle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for value in (str(tmp_path / "gone"), "relative", ""):
        monkeypatch.setenv("XDG_RUNTIME_DIR", value)
        ControlSocket().close()
    assert (tmp_path / f"humanoid_sim-{os.getuid()}").is_dir()


def test_a_folder_that_cannot_be_made_and_a_path_too_long_are_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / f"humanoid_sim-{os.getuid()}").touch()
    with pytest.raises(InputError, match="cannot be made: File exists"):
        ControlSocket()
    deep = tmp_path / ("d" * 120)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    with pytest.raises(InputError, match="cannot listen for intents: AF_UNIX path too long"):
        ControlSocket()
    with pytest.raises(InputError, match="cannot be reached: AF_UNIX path too long"):
        send_intent(1, Intent.DAMP)


# The program.


def run(*arguments: str) -> int:
    return run_program(mode.main, arguments)


def test_the_program_sends_to_the_only_session(control: ControlSocket, capsys: pytest.CaptureFixture[str]) -> None:
    status: list[int] = []
    got = serve(control, 100, lambda: status.append(run("damp")))
    assert (got, status) == ([Intent.DAMP], [0])
    assert capsys.readouterr().out == f"session {os.getpid()}: DAMPING (damping_controller): DAMP requested\n"


def test_the_program_needs_a_session(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    assert run("damp") == 2
    assert capsys.readouterr().err == "error: no session is running; start one with play\n"
    assert run("damp", "--session", "1") == 2
    assert capsys.readouterr().err == "error: --session: 1 is no running session; running: none\n"
    with pytest.raises(SystemExit) as caught:
        run("jump")
    assert caught.value.code == 2
