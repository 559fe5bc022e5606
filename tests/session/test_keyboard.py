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

from humanoid_sim.messages import Intent
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.sources import VelocityCommand


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


def test_keys_typed_while_the_process_stood_still_only_damp(terminal, keyboard, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("humanoid_sim.session.keyboard.monotonic", lambda: now[0])
    late = keyboard()
    terminal.type("b")
    assert heard(late, 1) == [Intent.LOAD_B]
    now[0] += 0.5
    terminal.type("la a")
    assert heard(late, 1) == [Intent.DAMP]
    terminal.type("rq")
    assert heard(late, 2) == [Intent.START_REMOTE, Intent.QUIT]


def test_the_terminal_is_given_back_as_it_was(terminal):
    before = termios.tcgetattr(terminal.slave)
    keyboard = Keyboard()
    during = termios.tcgetattr(terminal.slave)
    assert not during[3] & (termios.ICANON | termios.ECHO)  # key by key, and not shown
    assert during[3] & termios.ISIG  # Ctrl-C stays a signal
    keyboard.close()
    assert termios.tcgetattr(terminal.slave) == before


def test_arrows_and_letters_change_the_velocity_up_to_its_limit(terminal, keyboard):
    velocity = VelocityCommand(np.zeros(3), np.array([[-0.2, 0.2], [-0.1, 0.1], [-0.1, 0.1]]))
    board = keyboard(velocity)
    for text, command in (
        ("w,", [0.1, 0.1, 0.0]),
        ("\x1b[D", [0.1, 0.1, 0.1]),
        ("\x1b[A\x1b[B\x1b[A\x1b[A", [0.2, 0.1, 0.1]),
        ("0", [0.0, 0.0, 0.0]),
    ):
        terminal.type(text)
        until(lambda command=command: board.poll(0.0, None) == [] and velocity.command.tolist() == command)


def test_one_key_requests_a_fresh_start(terminal, keyboard):
    reactivation = Reactivation()
    listening = keyboard(reactivation=reactivation)
    terminal.type("\x1be")  # alt e
    terminal.type("d")
    heard(listening, 1)
    assert not reactivation.is_requested
    terminal.type("e")
    until(lambda: listening.poll(0.0, None) == [] and reactivation.is_requested)
