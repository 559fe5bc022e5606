import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from humanoid_sim import mode
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Intent

OTHER = """
import sys
sys.path[:0] = sys.argv[1:]
from local_session import LocalSession
session = LocalSession()
with session.stack:
    print("ready", flush=True)
    for line in sys.stdin:
        if line == "end\\n":
            break
        record = session.tick()
        print(*(intent.name for intent in record.input.intents), "in", record.output.control_mode.mode.name, flush=True)
"""


def run(*arguments):
    return run_program(mode.main, arguments)


def serve(local, work, *others):
    """Tick until the work is done, as the loop would; the intents that came beside those of others."""
    got = []
    thread = threading.Thread(target=work)
    thread.start()
    while thread.is_alive():
        got += local.tick(*others).input.intents[len(others) :]
        thread.join(0.002)
    return got


@pytest.fixture
def other(local):
    """Another session, in a process of its own; each line to it is a tick."""
    folders = [str(Path(__file__).parent / name) for name in ("session", "controllers")]
    with subprocess.Popen(
        [sys.executable, "-c", OTHER, *folders], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        yield process
        process.communicate("end\n")


def told():
    return f"session {os.getpid()} (three, policy p.onnx, started in {os.getcwd()})"


@pytest.mark.parametrize("word", ["damp", "stop"])
def test_it_names_the_session_that_it_reached(word, local, capsys):
    status = []
    assert serve(local, lambda: status.append(run(word))) == [Intent.DAMP]
    assert status == [0]
    assert capsys.readouterr().out == f"{told()}: DAMPING (damping_controller): DAMP requested\n"


def test_a_policy_is_selected_by_its_name(local, capsys):
    status = []
    serve(local, lambda: status.append(run("policy", "--name", "dance")))
    serve(local, lambda: status.append(run("policy", "--name", "danse")))
    assert status == [0, 1]
    granted, refused = capsys.readouterr().out.splitlines()
    assert granted.endswith("policy dance selected")
    assert "did you mean 'dance'?" in refused


def test_a_damp_is_granted_although_others_are_refused_with_it(local, capsys):
    status = []
    serve(local, lambda: status.append(run("damp")), Intent.LOAD_A, Intent.QUIT)
    assert status == [0]
    assert "LOAD_A refused: DAMP came in the same tick" in capsys.readouterr().out


def test_damp_goes_to_all_sessions_even_if_one_hangs_and_everything_else_to_one(local, other, monkeypatch, capsys):
    status = []
    monkeypatch.setattr(mode, "_TIMEOUT", 1.0)
    assert serve(local, lambda: status.append(run("damp"))) == [Intent.DAMP]
    captured = capsys.readouterr()
    assert captured.out == f"{told()}: DAMPING (damping_controller): DAMP requested\n"
    assert captured.err.startswith(f"error: session {other.pid} (three, policy p.onnx, started in ")
    assert captured.err.endswith("): did not answer within 1 s\n")
    other.stdin.write("tick\n")
    other.stdin.flush()
    assert other.stdout.readline() == "DAMP in DAMPING\n", "as soon as it goes on"
    status.append(run("load_a"))
    listed = capsys.readouterr().err
    assert listed.startswith("error: --session: is needed where several sessions run; running: session ")
    assert told() in listed
    assert f"session {other.pid} (" in listed
    assert serve(local, lambda: status.append(run("load_a", "--session", str(os.getpid())))) == [Intent.LOAD_A]
    assert status == [1, 2, 0]
