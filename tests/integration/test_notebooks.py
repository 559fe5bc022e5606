"""The notebooks run from top to bottom in a real kernel, and show what is stored in them."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.integration, pytest.mark.timeout(600)]

FOLDER = Path(__file__).parents[2] / "notebooks"
LIMIT = 300
"""s, of one cell."""


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_is_stored(path, tmp_path):
    program = [sys.executable, str(FOLDER / "store.py"), "--check", "--limit", str(LIMIT), str(path)]
    done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.startswith(path.name)
