"""Tests with the real `lerobot`; they run in an environment of its own, by `make test-lerobot`."""

import pytest


@pytest.fixture(autouse=True)
def no_leaks():
    """No test here is failed for what stays open: PyTorch, Arrow and W&B keep threads, maps and sockets for good."""
