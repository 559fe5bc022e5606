"""The bytes of an emulated keyboard on a FIFO and on a terminal, and ports where this machine has a sequencer."""

import io
import sys
import types
from collections import deque
from typing import ClassVar

import pytest
from emulated_keyboard import on_fifo, on_terminal

from humanoid_sim.errors import InputError
from humanoid_sim.frontends.midi.device import ByteDevice, Port, port_names

EVERY_BYTE = bytes(range(256))


@pytest.fixture(params=["fifo", "terminal"])
def plugged(request, tmp_path):
    return on_terminal if request.param == "terminal" else lambda: on_fifo(tmp_path / "keys")


def everything(device):
    """What has come; None if the keyboard is gone."""
    found = b""
    while data := device.read(0.2):
        found += data
    return None if data is None else found


def test_every_byte_arrives_as_it_was_sent(plugged):
    with plugged() as keyboard:
        device = ByteDevice(keyboard.path, 31250)
        assert device.read(0.0) == b""
        keyboard.send(*EVERY_BYTE)
        assert everything(device) == EVERY_BYTE
        device.close()


def test_one_that_is_unplugged_is_gone_and_what_it_said_before_is_heard(plugged):
    with plugged() as keyboard:
        device = ByteDevice(keyboard.path, 31250)
        assert device.read(0.0) == b""
        keyboard.unplug()
        assert device.read(1.0) is None
        device.close()
    with pytest.raises((InputError, ConnectionError)):
        ByteDevice(keyboard.path, 31250)


def test_what_is_no_keyboard_is_refused_in_a_line(tmp_path, monkeypatch):
    (tmp_path / "notes.bin").write_bytes(b"\x90\x3c\x40")
    accepted = "is a file or folder, expected a MIDI device, a serial line or a FIFO"
    for path in (tmp_path / "notes.bin", tmp_path):
        with pytest.raises(InputError, match=f"^--device: {path} {accepted}$"):
            ByteDevice(str(path), 31250)
    with pytest.raises(InputError, match=r"^--device: /nowhere cannot be opened: No such file or directory$"):
        ByteDevice("/nowhere", 31250)
    with on_terminal() as keyboard, io.open(keyboard.path, "rb", buffering=0) as stream:  # noqa: UP020
        monkeypatch.setattr(sys, "stdin", stream)
        with pytest.raises(InputError, match=r"^--device: standard input is a terminal, expected a pipe with a key"):
            ByteDevice("-", 31250)


class FakeInput:
    """As much of `rtmidi.MidiIn` as is used; what is plugged in is the class's."""

    ports: ClassVar[list[str]] = []
    messages: ClassVar[deque[tuple[list[int], float]]] = deque()
    open_inputs = 0

    def __init__(self, name):
        FakeInput.open_inputs += 1

    def get_ports(self):
        return list(self.ports)

    def ignore_types(self, *, sysex, timing, active_sense):
        assert (sysex, timing, active_sense) == (True, True, False)

    def open_port(self, number, name):
        self.opened = self.ports[number]

    def get_message(self):
        return self.messages.popleft() if self.messages else None

    def close_port(self): ...

    def delete(self):
        FakeInput.open_inputs -= 1


def test_a_port_is_chosen_by_a_part_of_its_name_and_missed_when_it_goes(monkeypatch):
    monkeypatch.setitem(sys.modules, "rtmidi", types.SimpleNamespace(MidiIn=FakeInput))
    monkeypatch.setattr(FakeInput, "ports", ["Midi Through:0 14:0", "Pads:0 20:0", "Keystation 88:0 24:0"])
    monkeypatch.setattr(FakeInput, "messages", deque([([0x90, 60, 64], 0.0), ([0xFE], 0.1)]))
    assert port_names() == ["Pads:0 20:0", "Keystation 88:0 24:0"]
    first, port = Port(""), Port("keystation")
    assert (first.name, port.name) == ("Pads:0 20:0", "Keystation 88:0 24:0")
    assert port.read(0.0) == b"\x90\x3c\x40\xfe"
    assert port.read(0.0) == b""
    monkeypatch.setattr(FakeInput, "ports", ["Midi Through:0 14:0", "Pads:0 20:0"])
    assert port.read(5.0) is None
    assert first.read(0.01) == b""
    for opened in (first, port):
        opened.close()
    with pytest.raises(ConnectionError):
        Port("keystation")
    assert FakeInput.open_inputs == 0
