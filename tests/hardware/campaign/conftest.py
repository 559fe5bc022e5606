"""Lets the tests of this folder import their helpers, and prints their table at the end of the run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))

_HEADINGS = (
    "fault",
    "mode",
    "flag",
    "detected ms",
    "reaction ms",
    "torque beyond damping N·m",
    "slow motion",
)
_ROWS = pytest.StashKey[list[tuple[str, ...]]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ROWS] = []


@pytest.fixture
def table(request: pytest.FixtureRequest) -> list[tuple[str, ...]]:
    """Rows of the campaign's table: fault, mode, flag, detection time, reaction time, torque."""
    rows: list[tuple[str, ...]] = request.config.stash.setdefault(_ROWS, [])
    return rows


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    rows = config.stash.get(_ROWS, [])
    if not rows:
        return
    widths = [max(len(row[column]) for row in (_HEADINGS, *rows)) for column in range(len(_HEADINGS))]
    terminalreporter.section("faults on emulated motors")
    for row in (_HEADINGS, *rows):
        terminalreporter.line("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
