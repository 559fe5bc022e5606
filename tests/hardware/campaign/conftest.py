"""Lets the tests of this folder import their helpers, and gives them their table."""

import sys
from pathlib import Path

import pytest

# importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent))

_HEADINGS = ("fault", "mode", "flag", "detected ms", "reaction ms", "torque beyond damping N·m", "slow motion")


@pytest.fixture
def table(table_of):
    """Rows of the campaign's table: fault, mode, flag, detection time, reaction time, torque."""
    return table_of("faults on emulated motors", _HEADINGS)
