from __future__ import annotations

import io
import os
import pty
import sys
import termios
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.session.keyboard import KEYS, REACTIVATE_KEY, Keyboard, KeyReader, key_help
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.sources import VELOCITY_KEYS, VelocityCommand, velocity_key_help


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
    assert f"{REACTIVATE_KEY} reactivate" in key_help()
    assert REACTIVATE_KEY not in {*KEYS, *VELOCITY_KEYS}


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_a_key_that_means_nothing_says_once_which_do(terminal: Terminal) -> None:
    told: list[str] = []
    keyboard = Keyboard(tell=told.append)
    terminal.type("d\x1b[A")
    heard(keyboard, 1)
    assert told == []
    terminal.type("w")  # a velocity key, where nothing walks
    until(lambda: told)
    terminal.type("xyzd")
    heard(keyboard, 1)
    keyboard.close()
    assert told == [f"the key 'w' means nothing; {key_help()}"]


def test_where_the_robot_walks_the_velocity_keys_mean_something(terminal: Terminal) -> None:
    told: list[str] = []
    keyboard = Keyboard(VelocityCommand(np.zeros(3)), tell=told.append)
    terminal.type("wsjk0d")
    heard(keyboard, 1)
    terminal.type("!")
    until(lambda: told)
    keyboard.close()
    assert told == [f"the key '!' means nothing; {key_help()}; {velocity_key_help()}"]


def test_one_key_asks_for_a_fresh_start(terminal: Terminal) -> None:
    reactivation = Reactivation()
    keyboard = Keyboard(reactivation=reactivation)
    terminal.type("\x1be")  # alt e
    terminal.type("d")
    heard(keyboard, 1)
    assert not reactivation.is_asked
    terminal.type("e")
    until(lambda: reactivation.is_asked)
    keyboard.close()
