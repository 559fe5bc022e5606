"""The program that executes notebooks, which is in no package."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def store() -> ModuleType:
    path = Path(__file__).parents[2] / "notebooks" / "store.py"
    spec = importlib.util.spec_from_file_location("notebook_store", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
