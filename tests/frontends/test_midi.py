"""Bytes of a keyboard become keys that are down, as a session observes them, until it is unplugged."""

import os
import types
from contextlib import contextmanager

import mido
import pytest
from hypothesis import given
from hypothesis import strategies as st
from local_session import LocalSession

from humanoid_sim.cli import run_program
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import midi_keyboard as module
from humanoid_sim.frontends.midi_keyboard import ByteDevice, Keyboard, Port, port_names
from humanoid_sim.midi import Sender, main


@contextmanager
def plugged_in(path):
    """A keyboard's bytes on a FIFO, until it is unplugged; a function that sends some."""
    if not path.exists():
        os.mkfifo(path)
    handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    try:
        yield lambda text: os.write(handle, bytes.fromhex(text))
    finally:
        os.close(handle)


def pressed(data):
    """Keys that are down after these bytes."""
    end, handle = os.pipe()
    keyboard = Keyboard(lambda: ByteDevice(f"/proc/self/fd/{end}"))
    try:
        os.write(handle, data)
        keyboard.poll()
        assert keyboard.pressed.shape == (88,)
        return [int(key) for key in keyboard.pressed.nonzero()[0]]
    finally:
        keyboard.close()
        os.close(handle)
        os.close(end)


@pytest.mark.parametrize(
    ("data", "down"),
    [
        ("90 15 01 90 6c 7f", [0, 87]),  # A0 and C8
        ("90 3c 40 80 3c 40", []),
        ("90 3c 40 90 3c 00", []),  # velocity 0 is off
        ("90 3c 40 fe 90 40 40", [39, 43]),  # active sensing
        ("3c 40 90 3c 40", [39]),  # from the middle of a message on
        ("90 3c 40 40 40 3c 00", [43]),  # running status: a status that repeats is left out
        ("90 3c 40 40 fe 40", [39, 43]),  # with active sensing within a message
        ("90 3c 40 f0 7e 01 f7 40 40", [39]),  # a system message ends it
        ("90 3c 40 90 3c 40 80 3c 00", []),  # struck twice, released once: there is one key
        ("90 3c 40 91 3c 40 80 3c 00", [39]),  # another channel holds it
        ("90 3c 40 b0 40 7f 80 3c 00", []),  # the pedal holds the string, not the key
        ("90 3c 40 91 40 40 b0 7b 00", [43]),  # all notes off, of one channel
        ("99 3c 40 90 14 40 90 6d 40", []),  # drums, and beyond the piano
    ],
)
def test_the_keys_that_are_down(data, down):
    assert pressed(bytes.fromhex(data)) == down


@given(st.binary(max_size=60))
def test_any_bytes_make_keys(data):
    assert set(pressed(data)) <= set(range(88))


@pytest.fixture
def session(runtime):
    local = LocalSession(takes={"key_pressed": 88})
    with local.stack:
        yield local


def down(record):
    """Keys that are down, as a policy observes them."""
    state = record.input.state
    keys = state.extern.get("key_pressed")
    return [] if keys is None else [int(key) for key in keys.at(state.time).nonzero()[0]]


def test_the_keys_reach_the_session_until_the_keyboard_is_unplugged_and_again_when_it_is_back(
    session, tmp_path, monkeypatch
):
    monkeypatch.setattr(module, "_RETRY", -1.0)
    path = tmp_path / "keys"
    with plugged_in(path) as send:
        keyboard = Keyboard(lambda: ByteDevice(str(path)))
        sender = Sender(session.intake("midi"), keyboard)
        send("90 3c 40 90 40 40 80 3c 00")
        assert sender.step() == []
        record = session.tick()
        assert down(record) == [43]
        first = record.input.state.extern["key_pressed"]
        assert (first.timeout, first.value.shape) == (0.5, (88,))
        for _ in range(100):
            sender.step()
            record = session.tick()
        assert record.input.state.time > first.arrival_time + 0.5
        assert down(record) == [43], "a key that stays down is sent again"
    assert sender.step() == ["the keyboard is gone: all keys released"]
    last = session.tick()
    assert down(last) == []
    assert sender.step() == []
    assert session.tick().input.state.extern == last.input.state.extern, "nobody knows any more"
    with plugged_in(path) as send:
        assert sender.step() == ["the keyboard is there again"]
        send("90 3e 40")
        sender.step()
        assert down(session.tick()) == [41]
    keyboard.close()


def test_a_port_is_chosen_by_a_part_of_its_name_and_missed_when_it_goes(monkeypatch):
    names = ["Midi Through:0 14:0", "Pads:0 20:0", "Keystation 88:0 24:0"]
    waiting = [mido.Message("note_on", note=60)]
    opened = []
    port = types.SimpleNamespace(iter_pending=lambda: list(waiting), close=lambda: None)
    monkeypatch.setattr(module.mido, "get_input_names", lambda: names)
    monkeypatch.setattr(module.mido, "open_input", lambda name: opened.append(name) or port)
    monkeypatch.setattr(module, "_CHECK_PERIOD", -1.0)
    assert port_names() == ["Pads:0 20:0", "Keystation 88:0 24:0"]
    Port("")
    found = Port("keystation")
    assert opened == ["Pads:0 20:0", "Keystation 88:0 24:0"]
    assert found.read() == bytes.fromhex("903c40")
    names.pop()
    assert found.read() is None
    with pytest.raises(InputError, match="no keyboard with 'keystation'; ports: Pads:0 20:0"):
        Port("keystation")


def test_what_cannot_work_is_one_line(tmp_path, capsys, monkeypatch, runtime):
    def missing():
        raise RuntimeError("error creating ALSA sequencer client object")

    monkeypatch.setattr(module.mido, "get_input_names", missing)
    with pytest.raises(InputError, match=r"no MIDI sequencer; --device reads .*: error creating"):
        port_names()
    assert run_program(main, ["--device", "/nowhere"]) == 2
    assert capsys.readouterr().err == "error: /nowhere: No such file or directory\n"
    monkeypatch.setattr("humanoid_sim.frontends.attach.os.nice", lambda _: 0)
    for takes, problem in (({}, "takes 0 keys"), ({"key_pressed": 61}, "takes 61 keys from outside, expected 88")):
        local = LocalSession(takes=takes)
        with local.stack, plugged_in(tmp_path / "keys"):
            assert run_program(main, ["--device", str(tmp_path / "keys")]) == 2
        assert problem in capsys.readouterr().err
