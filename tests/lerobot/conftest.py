"""Tests with the real `lerobot`; they run in an environment of its own, by `make test-lerobot`."""

import sys
from pathlib import Path

import pytest

# Shared samples are modules of the tests of `prepare`; importlib mode leaves sys.path alone.
sys.path.append(str(Path(__file__).parent.parent / "prepare"))
sys.path.append(str(Path(__file__).parent.parent / "recording"))


@pytest.fixture(autouse=True)
def no_leaks():
    """No test here is failed for what stays open: PyTorch, Arrow and W&B keep threads, maps and sockets for good."""
