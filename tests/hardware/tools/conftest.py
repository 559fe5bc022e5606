"""Mock motors for the tools, and a way to run these within this process."""

import io
import time
from types import SimpleNamespace

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robstride import link, motors
from humanoid_sim.hardware.sito import motors as sito_motors
from humanoid_sim.hardware.tools import identify, main, robstride


@pytest.fixture
def run(capsys):
    """Run `hardware` with these words: exit status, what it printed, what it complained of."""

    def run_tool(*words):
        status = run_program(main, words)
        printed, complained = capsys.readouterr()
        return status, printed, complained

    return run_tool


@pytest.fixture
def types(monkeypatch):
    """Let an operator type these lines on a terminal."""

    def type_lines(*lines):
        terminal = io.StringIO("".join(f"{line}\n" for line in lines))
        monkeypatch.setattr(terminal, "isatty", lambda: True)
        monkeypatch.setattr("sys.stdin", terminal)

    return type_lines


@pytest.fixture
def table_rows():
    """The cells of a printed table, row by row, without its headings."""

    def rows(printed):
        lines = printed.splitlines()
        ruler = next(i for i, line in enumerate(lines) if "─" in line)
        return [line.split() for line in lines[ruler + 1 :] if line.strip()]

    return rows


@pytest.fixture(autouse=True)
def pace(monkeypatch):
    """A tool need not wait for a real bus, but for mock motors that a busy machine holds up: it has their clock."""
    monkeypatch.setattr(robstride, "_PACE", 0.0003)
    monkeypatch.setattr(robstride, "_QUIET", 0.12)  # more than the motors may be behind
    monkeypatch.setattr(sito_motors, "_FIRST_FEEDBACK", 20.0)
    enter = MockServer.__enter__

    def with_clock(server):
        own = SimpleNamespace(monotonic=server.clock, sleep=time.sleep)
        for module in (link, motors, identify):
            monkeypatch.setattr(module, "time", own)
        return enter(server)

    monkeypatch.setattr(MockServer, "__enter__", with_clock)
