"""The program that executes notebooks, which is in no package."""

from pathlib import Path

import pytest
from script_files import load_script


@pytest.fixture(scope="module")
def store():
    return load_script(Path(__file__).parents[2] / "notebooks" / "store.py")
