"""The program with an emulated keyboard, on a session without a loop."""

import signal
import subprocess

import pytest
from dds_bridge import program
from emulated_keyboard import on_fifo
from local_session import LocalSession, ticking
from waiting import until

from humanoid_sim.cli import run_program
from humanoid_sim.frontends.midi.keyboard import ByteDevice, Keyboard
from humanoid_sim.midi import Sender, main

PATIENCE = 60.0
"""s for anything that only has to happen."""


@pytest.fixture
def session(runtime):
    """That takes a piano's keys."""
    local = LocalSession(takes={"key_pressed": 88})
    with local.stack:
        yield local


@pytest.fixture
def keyboard(tmp_path):
    with on_fifo(tmp_path / "keys") as plugged:
        yield plugged


def down(record):
    """Keys that are down, as a policy observes them."""
    state = record.input.state
    keys = state.extern.get("key_pressed")
    return [] if keys is None else [int(key) for key in keys.at(state.time).nonzero()[0]]


def test_each_period_tells_which_keys_are_down_and_when_that_was_known(session, keyboard):
    sender = Sender(session.intake("midi"), Keyboard(ByteDevice(keyboard.path), lambda: ByteDevice(keyboard.path)))
    assert sender.step() == []
    assert down(session.tick()) == []
    keyboard.press(60, 64)
    keyboard.release(60)
    sender.step()
    record = session.tick()
    assert down(record) == [43]
    keys = record.input.state.extern["key_pressed"]
    assert (keys.timeout, keys.value.shape) == (0.5, (88,))
    assert 0.0 <= record.input.state.time - keys.arrival_time < 60.0
    sender.step()
    again = session.tick().input.state.extern["key_pressed"]
    assert again.arrival_time > keys.arrival_time, "a key that stays down is told again"
    keyboard.unplug()
    (line,) = sender.step()
    assert line == f"{keyboard.path} is gone: all keys released"
    last = session.tick()
    assert down(last) == []
    for _ in range(3):
        assert sender.step() == []
    after = session.tick()
    assert after.input.state.extern["key_pressed"] is last.input.state.extern["key_pressed"], "nobody knows any more"


def running(session, *options, **streams):
    """The program, once it listens."""
    given = ("--session", str(session.info.process), *options)
    return program("midi", *given, says="the keys of ", stderr=subprocess.STDOUT, **streams)


@pytest.mark.soak
def test_the_program_plays_stops_loses_and_finds_the_keyboard(session, keyboard, tmp_path):
    with running(session, "--device", keyboard.path, "--transpose", "12") as (process, _):
        with ticking(session) as records:
            keyboard.press(48, 52)
            until(lambda: down(records[-1]) == [39, 43])
            until(lambda: session.data.owners["key_pressed"].startswith("midi ("))
            process.send_signal(signal.SIGSTOP)
            until(lambda: down(records[-1]) == [])  # by its timeout
            keyboard.release(48)
            stopped = len(records)
            process.send_signal(signal.SIGCONT)
            until(lambda: down(records[-1]) == [43])
            assert [down(record) for record in records[stopped:] if down(record) not in ([], [43])] == []
            keyboard.unplug()
            assert process.stdout.readline() == f"{keyboard.path} is gone: all keys released\n"
            until(lambda: down(records[-1]) == [])
            with on_fifo(tmp_path / "keys") as replugged:
                assert process.stdout.readline() == f"{keyboard.path} is there again\n"
                replugged.press(50)
                until(lambda: down(records[-1]) == [41])
        session.registration.close()
        assert process.wait(PATIENCE) == 0, "it ends with the session"


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (("--port", "x", "--device", "y"), "--port and --device: expected at most one of them"),
        (("--device", "y", "--transpose", "88"), "--transpose: is 88 semitones, expected -87 to 87"),
        (("--device", "/nowhere"), "--device: /nowhere cannot be opened: No such file or directory"),
    ],
)
def test_what_cannot_work_is_one_line(options, problem, capsys):
    assert run_program(main, list(options)) == 2
    assert capsys.readouterr().err == f"error: {problem}\n"


@pytest.mark.parametrize(
    ("takes", "problem"),
    [
        ({}, "takes no keys from outside: its policy plays no piano"),
        ({"key_pressed": 61}, "its policy's piano has 61 keys, expected 88"),
    ],
)
def test_a_session_without_such_keys_is_refused(takes, problem, monkeypatch, keyboard, capsys, runtime):
    local = LocalSession(takes=takes)
    with local.stack:
        monkeypatch.setattr("humanoid_sim.frontends.attach.os.nice", lambda _: 0)
        assert run_program(main, ["--device", keyboard.path]) == 2
    assert capsys.readouterr().err.endswith(f": {problem}\n")
