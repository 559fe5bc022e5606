"""What every tool refuses to do, and what it says of a motor that is silent."""

import io
import shlex

import pytest
from refusals import is_said, refusals

_PLACES = {"NOBODY": "virtual:nobody", "SHARED": "udp_multicast:239.74.163.62"}
"""Nobody answers on the first; the second could be another process'."""


def _words(line):
    for name, address in _PLACES.items():
        line = line.replace(name, address)
    return shlex.split(line)


@pytest.mark.parametrize(("line", "message"), refusals(__file__))
def test_options_that_are_not_accepted_are_one_line_and_leave_nothing(run, tmp_path, monkeypatch, line, message):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.chdir(tmp_path)
    status, printed, complained = run(*_words(line))
    assert (status, printed) == (2, "")
    assert is_said(message, complained), complained
    assert list(tmp_path.iterdir()) == []


def test_status_3_where_the_motor_is_silent(run):
    status, _, complained = run(*_words("identify NOBODY left_wrist_yaw --yes"))
    assert (status, "motor 15 does not answer on virtual:nobody" in complained) == (3, True)
