import os
import pty
import select
import sys
import termios
from contextlib import closing

import numpy as np
import pytest
from waiting import until

from humanoid_sim.messages import Intent
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.sources import VelocityCommand


@pytest.fixture
def typed(monkeypatch):
    """A function that types at a pseudo-terminal, which is this process's standard input."""
    master, slave = pty.openpty()
    with os.fdopen(master, "wb", buffering=0) as keys, os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda text: keys.write(text.encode())


def heard(keyboard, count):
    """The next intents, so many."""
    intents = []
    until(lambda: intents.extend(keyboard.poll(0.0, None)) or len(intents) >= count)
    return intents


def test_keys_become_intents(typed):
    with closing(Keyboard()) as keyboard:
        typed(" dabLrRq")
        names = [intent.name for intent in heard(keyboard, 8)]
        assert names == ["DAMP", "DAMP", "LOAD_A", "LOAD_B", "START_LOCOMOTION", "START_REMOTE", "START_REMOTE", "QUIT"]
        typed("xyz\n1\trq")  # whatever else is on a keyboard does nothing
        assert heard(keyboard, 2) == [Intent.START_REMOTE, Intent.QUIT]


def test_a_terminal_that_is_another_programs_damps_once_and_counts_again_when_it_is_back(typed, monkeypatch):
    def refuse(*_):
        raise OSError(5, "Input/output error")  # of a process in the background

    with closing(Keyboard()) as keyboard:
        typed("l")
        until(lambda: select.select([sys.stdin], [], [], 0.0)[0])
        with monkeypatch.context() as background:
            background.setattr(os, "read", refuse)
            assert [*keyboard.poll(0.0, None), *keyboard.poll(0.0, None)] == [Intent.DAMP]
        typed(" ")
        assert heard(keyboard, 2) == [Intent.START_LOCOMOTION, Intent.DAMP]


def test_the_terminal_is_given_back_as_it_was(typed):
    before = termios.tcgetattr(sys.stdin)
    keyboard = Keyboard()
    during = termios.tcgetattr(sys.stdin)
    assert not during[3] & (termios.ICANON | termios.ECHO)  # key by key, and not shown
    assert during[3] & termios.ISIG  # Ctrl-C stays a signal
    keyboard.close()
    assert termios.tcgetattr(sys.stdin) == before


def test_arrows_and_letters_change_the_velocity_up_to_its_limit_and_one_key_requests_a_fresh_start(typed):
    velocity = VelocityCommand(np.zeros(3), np.array([[-0.2, 0.2], [-0.1, 0.1], [-0.1, 0.1]]))
    requests = Requests()
    with closing(Keyboard(velocity, requests=requests)) as keyboard:
        for text, command in (
            ("w,", [0.1, 0.1, 0.0]),
            ("\x1b[D", [0.1, 0.1, 0.1]),
            ("\x1b[A\x1b[B\x1b[A\x1b[1;5B\x1b[A", [0.2, 0.1, 0.1]),  # the fourth is with Ctrl
            ("0", [0.0, 0.0, 0.0]),
        ):
            typed(text)
            until(lambda command=command: keyboard.poll(0.0, None) == [] and velocity.command.tolist() == command)
        typed("\x1bed")  # alt e
        assert heard(keyboard, 1) == [Intent.DAMP]
        assert not requests.is_reactivation
        typed("e")
        until(lambda: keyboard.poll(0.0, None) == [] and requests.is_reactivation)
