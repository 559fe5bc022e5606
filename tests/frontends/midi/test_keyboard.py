"""Bytes of a keyboard become keys that are down, until it is unplugged."""

import sys
import types

import mido
import pytest
from emulated_keyboard import on_fifo
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.errors import InputError
from humanoid_sim.frontends.midi import keyboard as module
from humanoid_sim.frontends.midi.keyboard import ByteDevice, Keyboard, Port, PressedKeys, WireParser, port_names


def pressed(data, pieces=1000, transpose=0):
    """Keys that are down after these bytes, which come in pieces."""
    keys, parser = PressedKeys(transpose), WireParser()
    for first in range(0, len(data), pieces):
        for message in parser.feed(data[first : first + pieces]):
            keys.take(message)
    assert keys.values.shape == (88,)
    return [int(key) for key in keys.values.nonzero()[0]]


@pytest.mark.parametrize("pieces", [1, 2, 1000])
@pytest.mark.parametrize(
    ("data", "down"),
    [
        ("90 15 01 90 6c 7f", [0, 87]),  # A0 and C8
        ("90 3c 40 80 3c 40", []),
        ("90 3c 40 90 3c 00", []),  # velocity 0 is off
        ("90 3c 40 3c 00 40 40", [43]),  # without a status byte
        ("90 3c f8 40 fe 40 f8 40", [39, 43]),  # real time within messages
        ("90 3c 40 f0 7e 09 3c 01 f7 40 40 90 3c 00", []),  # exclusive ends the running status
        ("90 3c 40 f2 10 20 40 40", [39]),  # common messages end it too
        ("3c 40 90 3c 40", [39]),  # from the middle of a message on
        ("90 3c 91 3c 40", [39]),  # cut off by the next
        ("c3 07 90 3c 40", [39]),  # one data byte
        ("90 3c 40 90 3c 40 80 3c 00", []),  # struck twice, released once: there is one key
        ("90 3c 40 91 3c 40 80 3c 00", [39]),  # another channel holds it
        ("90 3c 40 b0 40 7f 80 3c 00", []),  # the pedal holds the string, not the key
        ("90 3c 40 91 40 40 b0 7b 00", [43]),  # all notes off, of one channel
        ("90 3c 40 b0 7c 00", []),  # a change of mode is all notes off, too
        ("90 3c 40 b0 79 00", [39]),  # reset all controllers is not
        ("90 3c 40 91 40 40 ff", []),  # system reset
        ("99 3c 40 90 14 40 90 6d 40", []),  # drums, and beyond the piano
    ],
)
def test_the_keys_that_are_down(data, down, pieces):
    assert pressed(bytes.fromhex(data), pieces) == down


def test_notes_are_transposed():
    assert pressed(bytes((0x90, 48, 64)), transpose=12) == [39]


@given(st.binary(max_size=60), st.integers(1, 60))
def test_any_bytes_make_the_same_keys_in_any_pieces(data, pieces):
    assert pressed(data, pieces) == pressed(data)


def test_one_that_is_unplugged_releases_its_keys_and_may_come_back(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.0)
    with on_fifo(tmp_path / "keys") as plugged:
        keyboard = Keyboard(ByteDevice(plugged.path), lambda: ByteDevice(plugged.path))
        plugged.press(60)
        assert keyboard.poll() == []
        assert keyboard.pressed.nonzero()[0].tolist() == [39]
        plugged.unplug()
        assert keyboard.poll() == [f"{plugged.path} is gone: all keys released"]
        assert not keyboard.pressed.any()
        assert not keyboard.is_known
        assert keyboard.poll() == []
    with on_fifo(tmp_path / "keys") as plugged:
        assert keyboard.poll() == [f"{plugged.path} is there again"]
        plugged.press(64)
        keyboard.poll()
        assert keyboard.pressed.nonzero()[0].tolist() == [43]
        keyboard.close()


def test_what_is_no_keyboard_is_refused_in_a_line(tmp_path):
    (tmp_path / "notes.bin").write_bytes(b"\x90\x3c\x40")
    for path in (tmp_path / "notes.bin", tmp_path):
        with pytest.raises(InputError, match="is a file or folder, expected a MIDI device or"):
            ByteDevice(str(path))
    with pytest.raises(InputError, match=r"^--device: /nowhere cannot be opened: No such file or directory$"):
        ByteDevice("/nowhere")


def test_a_port_is_chosen_by_a_part_of_its_name_and_missed_when_it_goes(monkeypatch):
    names = ["Midi Through:0 14:0", "Pads:0 20:0", "Keystation 88:0 24:0"]
    waiting = [mido.Message("note_on", note=60)]
    opened = types.SimpleNamespace(iter_pending=lambda: list(waiting), close=lambda: None)
    monkeypatch.setattr(module.mido, "get_input_names", lambda: names)
    monkeypatch.setattr(module.mido, "open_input", lambda _: opened)
    monkeypatch.setattr(module, "_CHECK_PERIOD", -1.0)
    assert port_names() == ["Pads:0 20:0", "Keystation 88:0 24:0"]
    assert Port("").name == "Pads:0 20:0"
    port = Port("keystation")
    assert port.read() == waiting
    names.pop()
    assert port.read() is None
    with pytest.raises(ConnectionError):
        Port("keystation")


def test_without_a_sequencer_it_says_so(monkeypatch):
    def missing():
        print("ALSA lib seq_hw.c: nothing", file=sys.stderr)
        raise RuntimeError("error creating ALSA sequencer client object")

    monkeypatch.setattr(module.mido, "get_input_names", missing)
    with pytest.raises(InputError, match=r"no MIDI sequencer: .*; --device takes the bytes"):
        port_names()
