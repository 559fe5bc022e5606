import os
import socket
import threading
from contextlib import suppress
from dataclasses import replace

import pytest

from humanoid_sim import client, mode
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Intent, Mode


class Program(threading.Thread):
    """`python -m humanoid_sim.mode` beside the session's loop."""

    def __init__(self, *words):
        super().__init__()
        self._words = words
        self.start()

    def run(self):
        self.status = run_program(mode.main, self._words)


def serve(local, *words, beside=()):
    """Tick until the program has ended; its status, and the intents that came beside those of others."""
    got, program = [], Program(*words)
    while program.is_alive():
        got += local.tick(*beside).input.intents[len(beside) :]
        program.join(0.002)
    return program.status, got


def told():
    return f"session {os.getpid()} (three, policy p.onnx, started in {os.getcwd()})"


@pytest.mark.parametrize("word", ["damp", "stop", "DAMP"])
def test_it_names_the_session_that_it_reached(word, local, capsys):
    assert serve(local, word) == (0, [Intent.DAMP])
    assert capsys.readouterr().out == f"{told()}: DAMPING (damping_controller): DAMP requested\n"


def test_a_policy_is_selected_by_its_name(local, capsys):
    assert [serve(local, "policy", "--name", name)[0] for name in ("dance", "danse")] == [0, 1]
    granted, refused = capsys.readouterr().out.splitlines()
    assert granted.endswith("policy dance selected")
    assert "did you mean 'dance'?" in refused


def test_a_damp_is_granted_although_others_are_refused_with_it(local, capsys):
    assert serve(local, "damp", beside=(Intent.LOAD_A, Intent.QUIT))[0] == 0
    assert "LOAD_A refused: DAMP came in the same tick" in capsys.readouterr().out


def test_damp_goes_to_all_sessions_even_if_one_hangs_and_everything_else_to_one(local, tmp_path, monkeypatch, capsys):
    """What was sent to that one before fills its socket, and whoever sends more must wait."""
    hangs, works = replace(local.info, process=1, path=tmp_path), local.info
    monkeypatch.setattr(client, "running_sessions", lambda: [hangs, works])
    monkeypatch.setattr(mode, "_TIMEOUT", 1.0)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as intents, socket.socket(socket.AF_UNIX, 2) as sender:
        intents.bind(str(tmp_path / "intents"))
        (tmp_path / "data").symlink_to(local.registration.path / "data")
        sender.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                sender.sendto(b"damp", str(tmp_path / "intents"))
        program = Program("damp")
        while local.tick().output.control_mode.mode is not Mode.DAMPING:
            program.join(0.002)
        intents.recv(100)  # room for another
        while program.is_alive():
            local.tick()
            program.join(0.002)
    captured = capsys.readouterr()
    assert captured.out == f"{told()}: DAMPING (damping_controller): DAMP requested\n"
    assert captured.err == f"error: {hangs}: did not answer within 1 s\n"
    refused, _ = serve(local, "load_a")
    assert (program.status, refused) == (1, 2)
    listed = capsys.readouterr().err
    assert listed.startswith("error: --session: is needed where several sessions run; running: session 1 (")
    assert told() in listed
    assert serve(local, "load_a", "--session", str(os.getpid())) == (0, [Intent.LOAD_A])
