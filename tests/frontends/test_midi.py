"""Messages of a keyboard become keys that are down, as a session observes them, until it is unplugged."""

import sys
import types

import mido
import pytest
from local_session import LocalSession

from humanoid_sim import midi as module
from humanoid_sim.cli import run_program
from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.midi import Keyboard, Sender, main

NAMES = ["Midi Through:0 14:0", "Pads:0 20:0", "Keystation 88:0 24:0"]


class Sequencer:
    """The system's MIDI ports, of which one is open."""

    def __init__(self):
        self.names, self.opened, self._waiting = [*NAMES], [], []

    def open_input(self, name):
        self.opened.append(name)
        return types.SimpleNamespace(iter_pending=self._pending, close=self._waiting.clear)

    def send(self, text):
        self._waiting += mido.parse_all(bytes.fromhex(text))

    def _pending(self):
        while self._waiting:
            yield self._waiting.pop(0)


@pytest.fixture
def sequencer(monkeypatch):
    made = Sequencer()
    monkeypatch.setitem(sys.modules, "rtmidi", types.SimpleNamespace())
    monkeypatch.setattr(module.mido, "get_input_names", lambda: made.names)
    monkeypatch.setattr(module.mido, "open_input", made.open_input)
    monkeypatch.setattr(module, "_CHECK_PERIOD", -1.0)
    return made


@pytest.mark.parametrize(
    ("data", "down"),
    [
        ("90 15 01 90 6c 7f", [0, 87]),  # A0 and C8
        ("90 3c 40 80 3c 40", []),
        ("90 3c 40 90 3c 00", []),  # velocity 0 is off
        ("90 3c 40 90 3c 40 80 3c 00", []),  # struck twice, released once: there is one key
        ("90 3c 40 91 3c 40 80 3c 00", [39]),  # another channel holds it
        ("90 3c 40 b0 40 7f 80 3c 00", []),  # the pedal holds the string, not the key
        ("90 3c 40 91 40 40 b0 7b 00", [43]),  # all notes off, of one channel
        ("99 3c 40 90 14 40 90 6d 40 fe c0 05", []),  # drums, beyond the piano, and other messages
    ],
)
def test_the_keys_that_are_down(sequencer, data, down):
    keyboard = Keyboard("")
    sequencer.send(data)
    keyboard.poll()
    assert keyboard.pressed.shape == (88,)
    assert keyboard.pressed.nonzero()[0].tolist() == down


def test_the_keys_are_sent_in_each_period_until_the_keyboard_is_unplugged(sequencer):
    keyboard, sent = Keyboard("keystation"), []
    assert sequencer.opened == [NAMES[2]]
    sender = Sender(types.SimpleNamespace(live=lambda *sample, stamp: sent.append((*sample, stamp))), keyboard)
    sequencer.send("90 3c 40 90 40 40 80 3c 00")
    sender.step()
    between = monotonic_ns()
    sender.step()
    for name, keys, stamp in sent:
        assert (name, [key for key, is_down in enumerate(keys) if is_down]) == ("key_pressed", [43])
        assert stamp < between, "as old as the poll before"
    assert len(sent) == 2, "a key that stays down is sent again"
    sequencer.names.pop()
    with pytest.raises(InputError, match=r"^Keystation 88:0 24:0: is gone"):
        sender.step()


def test_what_cannot_work_is_one_line(sequencer, capsys, monkeypatch, runtime):
    with pytest.raises(InputError, match="no keyboard with 'nord'; ports: Pads:0 20:0, Keystation 88:0 24:0"):
        Keyboard("nord")
    monkeypatch.setattr("humanoid_sim.frontends.attach.os.nice", lambda _: 0)
    with LocalSession(takes={"key_pressed": 61}).stack:
        assert run_program(main, []) == 2
    assert "takes 61 keys from outside, expected 88" in capsys.readouterr().err

    def missing():
        raise RuntimeError("error creating ALSA sequencer client object")

    monkeypatch.setattr(module.mido, "get_input_names", missing)
    with pytest.raises(InputError, match=r"no MIDI sequencer: error creating"):
        Keyboard("")
    monkeypatch.setitem(sys.modules, "rtmidi", None)
    with pytest.raises(MissingPackageError, match=r"'rtmidi'.*humanoid_sim\[midi\]"):
        Keyboard("")
