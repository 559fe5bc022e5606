"""The program that executes notebooks, which is in no package."""

import importlib.util
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def store():
    path = Path(__file__).parents[2] / "notebooks" / "store.py"
    spec = importlib.util.spec_from_file_location("notebook_store", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
