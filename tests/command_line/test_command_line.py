"""What is wrong with a command line is said in one line."""

import os
import shlex
import subprocess
import sys

import pytest
from refusals import is_said, refusals

from humanoid_sim.cli import main


@pytest.mark.parametrize(("command", "line"), refusals(__file__))
def test_one_line(command, line, capsys):
    assert main(shlex.split(command)) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert is_said(line, error), error


def test_underscores_do_as_well(capsys):
    assert main(["play", "--policy_seconds", "x"]) == 2
    assert capsys.readouterr().err.startswith("error: Error parsing --policy-seconds: ")


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_one_line_in_whatever_encoding(encoding):
    run = subprocess.run(
        [sys.executable, "-m", "humanoid_sim.play", "--yaw", "x"],
        env={**os.environ, "PYTHONIOENCODING": encoding},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (run.returncode, run.stdout, run.stderr.count("\n")) == (2, "", 1)
    assert run.stderr.startswith("error: Error parsing --yaw: could not convert string to float: 'x'; ")
