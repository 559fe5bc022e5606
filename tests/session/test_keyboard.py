from __future__ import annotations

import io
import os
import pty
import sys
import termios
import time
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.session.keyboard import KEYS, Keyboard, KeyReader, key_help


@dataclass
class Terminal:
    """A pseudo-terminal whose slave is this process's standard input."""

    master: int
    slave: int
    is_open: bool = True

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def hang_up(self) -> None:
        os.close(self.master)
        self.is_open = False


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    master, slave = pty.openpty()
    result = Terminal(master, slave)
    with os.fdopen(slave, closefd=False) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield result
    os.close(slave)
    if result.is_open:
        os.close(master)


def heard(keyboard: Keyboard, count: int) -> list[Intent]:
    """The next intents; fails if fewer come."""
    intents: list[Intent] = []
    deadline = time.monotonic() + 5.0
    while len(intents) < count and time.monotonic() < deadline:
        intents += keyboard.poll(0.0, None)
        time.sleep(0.005)
    assert len(intents) == count, intents
    return intents


def test_keys_become_intents(terminal: Terminal) -> None:
    keyboard = Keyboard()
    try:
        terminal.type(" dabLrRq")
        assert heard(keyboard, 8) == [
            Intent.DAMP,
            Intent.DAMP,
            Intent.LOAD_A,
            Intent.LOAD_B,
            Intent.START_LOCOMOTION,
            Intent.START_REMOTE,
            Intent.START_REMOTE,
            Intent.QUIT,
        ]
        terminal.type("xyz\n1\tq")  # whatever else is on a keyboard does nothing
        assert heard(keyboard, 1) == [Intent.QUIT]
        assert not keyboard.finished
    finally:
        keyboard.close()


def test_the_terminal_is_given_back_as_it_was(terminal: Terminal) -> None:
    before = termios.tcgetattr(terminal.slave)
    keyboard = Keyboard()
    during = termios.tcgetattr(terminal.slave)
    assert not during[3] & (termios.ICANON | termios.ECHO)  # key by key, and not shown
    assert during[3] & termios.ISIG  # Ctrl-C stays a signal
    keyboard.close()
    assert termios.tcgetattr(terminal.slave) == before


def test_a_terminal_that_goes_away_damps(terminal: Terminal) -> None:
    keyboard = Keyboard()
    terminal.hang_up()
    assert heard(keyboard, 1) == [Intent.DAMP]
    keyboard.close()


def test_without_a_terminal_there_is_no_keyboard(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("d"))
    with pytest.raises(InputError, match="--manual: standard input is no terminal"):
        Keyboard()
    with open(os.devnull, encoding="utf-8") as null:
        monkeypatch.setattr(sys, "stdin", null)
        with pytest.raises(InputError, match="--manual: standard input is no terminal"):
            Keyboard()


SEQUENCES = {
    "up": "\x1b[A",
    "down": "\x1b[B",
    "right": "\x1b[C",
    "F1": "\x1bOP",
    "F2": "\x1bOQ",
    "F3": "\x1bOR",
    "shift up": "\x1b[1;2A",
    "alt a": "\x1ba",
    "alt q": "\x1bq",
    "delete": "\x1b[3~",
}


@pytest.mark.parametrize("name", SEQUENCES)
def test_keys_that_send_letters_move_nothing(name: str) -> None:
    text = SEQUENCES[name]
    assert KeyReader().intents(text) == []
    for cut in range(1, len(text)):  # a slow line may cut it anywhere
        reader = KeyReader()
        assert reader.intents(text[:cut]) + reader.intents(text[cut:]) == []
        assert reader.intents("a") == [Intent.LOAD_A]  # and the next key counts again


def test_damp_is_heard_even_beside_an_escape_sequence() -> None:
    assert KeyReader().intents("\x1b[A ") == [Intent.DAMP]
    reader = KeyReader()
    assert reader.intents("\x1b") == []
    assert reader.intents(" ") == [Intent.DAMP]


def test_the_help_names_every_intent() -> None:
    for intent in KEYS.values():
        assert intent.name in key_help()
    assert set(KEYS.values()) == set(Intent)
