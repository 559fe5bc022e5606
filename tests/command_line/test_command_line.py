"""What is wrong with a command line is said in one line."""

import os
import shlex
import subprocess
import sys

import pytest
from refusals import is_said, refusals

from humanoid_sim.cli import main

HELP = "--help' says what is accepted"


@pytest.mark.parametrize(("command", "line"), refusals(__file__))
def test_one_line(command, line, capsys):
    assert main(shlex.split(command)) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert is_said(line, error), error


def test_underscores_do_as_well(capsys):
    assert main(["play", "--policy_seconds", "x"]) == 2
    assert capsys.readouterr().err.startswith("error: --policy-seconds: is 'x', expected a number; ")


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_whatever_the_terminal_can_show(encoding):
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.play", "--yaw", "x" * 300],
        env={**os.environ, "PYTHONIOENCODING": encoding, "COLUMNS": "40"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == f"error: --yaw: is '{'x' * 300}', expected a number; 'python -m humanoid_sim.play {HELP}\n"


def test_a_group_of_commands_alone_lists_them(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["policy"])
    assert ended.value.code == 0
    alone = capsys.readouterr().out
    assert alone.startswith("usage: python -m humanoid_sim.policy COMMAND ...\n")
    with pytest.raises(SystemExit):
        main(["policy", "--help"])
    assert capsys.readouterr().out == alone
