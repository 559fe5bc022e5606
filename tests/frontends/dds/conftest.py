"""Lets the modules here import their neighbours: importlib mode leaves sys.path alone."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent))


@pytest.fixture
def domain(monkeypatch):
    """Also of the programs that the test starts."""
    from dds_bridge import free_domain  # noqa: PLC0415 - on the path as of here

    found = free_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(found))
    return found
