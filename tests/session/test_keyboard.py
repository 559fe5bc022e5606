import io
import os
import pty
import sys
import termios
import time
from contextlib import ExitStack, closing
from dataclasses import dataclass

import numpy as np
import pytest
from waiting import until

from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.session.keyboard import HELP_KEYS, KEYS, REACTIVATE_KEY, Keyboard, KeyReader, key_help, key_of
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.sources import VELOCITY_KEYS, VelocityCommand, velocity_key_help


@dataclass
class Terminal:
    """A pseudo-terminal whose slave is this process's standard input."""

    master: int
    slave: int
    is_open: bool = True

    def type(self, text):
        os.write(self.master, text.encode())

    def hang_up(self):
        os.close(self.master)
        self.is_open = False


@pytest.fixture
def terminal(monkeypatch):
    master, slave = pty.openpty()
    result = Terminal(master, slave)
    with os.fdopen(slave, closefd=False) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield result
    os.close(slave)
    if result.is_open:
        os.close(master)


def heard(keyboard, count):
    """The next intents; fails if fewer come."""
    intents = []
    deadline = time.monotonic() + 30.0
    while len(intents) < count and time.monotonic() < deadline:
        intents += keyboard.poll(0.0, None)
        time.sleep(0.005)
    assert len(intents) == count, intents
    return intents


@pytest.fixture
def keyboard(terminal):
    """`keyboard(...)`: one that listens to the terminal, until the test ends."""
    with ExitStack() as stack:
        yield lambda *given, **options: stack.enter_context(closing(Keyboard(*given, **options)))


def test_keys_become_intents(terminal, keyboard):
    heard_by = keyboard()
    terminal.type(" dabLrRq")
    names = [intent.name for intent in heard(heard_by, 8)]
    assert names == ["DAMP", "DAMP", "LOAD_A", "LOAD_B", "START_LOCOMOTION", "START_REMOTE", "START_REMOTE", "QUIT"]
    terminal.type("xyz\n1\tq")  # whatever else is on a keyboard does nothing
    assert heard(heard_by, 1) == [Intent.QUIT]
    assert not heard_by.finished


@pytest.mark.soak
def test_a_key_that_the_loop_hears_too_late_moves_nothing(terminal, keyboard):
    told = []
    late = keyboard(record=told.append)
    terminal.type("a ")
    time.sleep(0.8)
    assert heard(late, 1) == [Intent.DAMP]
    (line,) = told
    assert line.startswith("LOAD_A refused: too late, it was meant for the robot of 0.")


def test_the_terminal_is_given_back_as_it_was(terminal):
    before = termios.tcgetattr(terminal.slave)
    keyboard = Keyboard()
    during = termios.tcgetattr(terminal.slave)
    assert not during[3] & (termios.ICANON | termios.ECHO)  # key by key, and not shown
    assert during[3] & termios.ISIG  # Ctrl-C stays a signal
    keyboard.close()
    assert termios.tcgetattr(terminal.slave) == before


def test_a_terminal_that_goes_away_damps(terminal, keyboard):
    orphan = keyboard()
    terminal.hang_up()
    assert heard(orphan, 1) == [Intent.DAMP]


def test_without_a_terminal_there_is_no_keyboard(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("d"))
    with pytest.raises(InputError, match="--manual: standard input is not a terminal"):
        Keyboard()
    with open(os.devnull, encoding="utf-8") as null:
        monkeypatch.setattr(sys, "stdin", null)
        with pytest.raises(InputError, match="--manual: standard input is not a terminal"):
            Keyboard()


SEQUENCES = {
    "F1": "\x1bOP", "F2": "\x1bOQ", "F3": "\x1bOR", "shift up": "\x1b[1;2A", "shift left": "\x1b[1;2D",
    "alt a": "\x1ba", "alt q": "\x1bq", "delete": "\x1b[3~",
}  # fmt: skip
ARROWS = {"up": "\x1b[A", "down": "\x1b[B", "right": "\x1b[C", "left": "\x1b[D"}


@pytest.mark.parametrize("name", SEQUENCES)
def test_keys_that_send_letters_mean_nothing(name):
    text = SEQUENCES[name]
    assert KeyReader().keys(text) == [text]
    assert text not in {*KEYS, *VELOCITY_KEYS, REACTIVATE_KEY, *HELP_KEYS}
    for cut in range(1, len(text)):  # a slow line may cut it anywhere
        reader = KeyReader()
        assert reader.keys(text[:cut]) + reader.keys(text[cut:]) == [text]
        assert reader.keys("a") == ["a"]  # and the next key counts again


@pytest.mark.parametrize("name", ARROWS)
def test_arrows_are_keys_of_their_own(name):
    for text in (ARROWS[name], ARROWS[name].replace("[", "O")):  # an application's mode of the terminal
        assert KeyReader().keys(text + text) == [name, name]
        for cut in range(1, len(text)):
            reader = KeyReader()
            assert reader.keys(text[:cut]) + reader.keys(text[cut:]) == [name]


def test_damp_is_heard_even_beside_an_escape_sequence():
    assert KeyReader().keys("\x1b[A ") == ["up", " "]
    assert KeyReader().keys("d\x1b[3~") == ["d", "\x1b[3~"]
    reader = KeyReader()
    assert reader.keys("\x1b") == []
    assert reader.keys(" ") == [" "]


def test_nothing_else_is_heard_beside_an_escape_sequence():
    for text in ("l\x1b[A", "\x1b[Al", "\x1b[Aup", "\x1b[3~b"):
        assert not {*KEYS, REACTIVATE_KEY, *HELP_KEYS} & set(KeyReader().keys(text))
    assert KeyReader().keys("\x1b[Aup") == ["up", "\x1bup"]


def test_the_help_names_every_intent():
    for intent in KEYS.values():
        assert f"{key_of(intent)} " in key_help()
        assert intent.name in key_help()
    assert set(KEYS.values()) == set(Intent)
    assert f"{REACTIVATE_KEY} reactivate" in key_help()
    assert len({REACTIVATE_KEY, *HELP_KEYS, *KEYS, *VELOCITY_KEYS}) == 3 + len(KEYS) + len(VELOCITY_KEYS)


def test_every_key_that_means_nothing_is_said(terminal, keyboard):
    told = []
    keyboard(tell=told.append)
    for count, text in enumerate(("w", "x", "\x1b[Ayz", "e"), 1):  # nothing walks or can be reactivated here
        terminal.type(text)
        until(lambda count=count: len(told) == count)
    shown = "nothing; h or ? shows those that do"
    assert told == [
        *(f"the key '{key}' means {shown}" for key in "wx"),
        f"the keys 'up', '\\x1byz' mean {shown}",
        f"the key 'e' means {shown}",
    ]


def test_h_and_the_question_mark_name_the_keys(terminal):
    told = []
    for velocity, text, lines in (
        ((), "hH?", [key_help()] * 3),
        ((VelocityCommand(np.zeros(3)),), "?", [key_help(), velocity_key_help()]),
    ):
        told.clear()
        with closing(Keyboard(*velocity, tell=told.append)):
            terminal.type(text)
            until(lambda lines=lines: len(told) == len(lines))
        assert told == lines


def test_arrows_and_letters_change_the_velocity_up_to_its_limit(terminal, keyboard):
    told = []
    velocity = VelocityCommand(np.zeros(3), np.array([[-0.2, 0.2], [-0.1, 0.1], [-0.1, 0.1]]))
    keyboard(velocity, tell=told.append)
    for text, command in (
        ("w,", [0.1, 0.1, 0.0]),
        ("\x1b[D", [0.1, 0.1, 0.1]),
        ("\x1b[A\x1b[B\x1b[A", [0.2, 0.1, 0.1]),
    ):
        terminal.type(text)
        until(lambda command=command: velocity.command.tolist() == command)
    assert told == []
    terminal.type("\x1b[A")
    until(lambda: told)
    terminal.type("0")
    until(lambda: not velocity.command.any())
    assert told == ["the velocity command is at its limit: 0.2 m/s, 0.1 m/s, 0.1 rad/s"]


def test_in_a_pause_only_damp_quit_and_a_stop_count(terminal):
    told, reactivation, velocity = [], Reactivation(), VelocityCommand(np.array([0.5, 0.0, 0.0]))
    keyboard = Keyboard(velocity, reactivation=reactivation, tell=told.append, is_paused=lambda: True)
    terminal.type("awed q")
    assert heard(keyboard, 3) == [Intent.DAMP, Intent.DAMP, Intent.QUIT]
    assert (velocity.command.tolist(), reactivation.is_asked) == ([0.5, 0.0, 0.0], False)
    keyboard.close()
    assert told == [f"the key '{key}' is left out: the robot's time is paused" for key in "awe"]


def test_one_key_asks_for_a_fresh_start(terminal, keyboard):
    reactivation = Reactivation()
    listening = keyboard(reactivation=reactivation)
    terminal.type("\x1be")  # alt e
    terminal.type("d")
    heard(listening, 1)
    assert not reactivation.is_asked
    terminal.type("e")
    until(lambda: reactivation.is_asked)
