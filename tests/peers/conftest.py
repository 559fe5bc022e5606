"""What mjlab and rsl_rl really export, made once by `make test-peers`; these tests judge the files."""

import os
from pathlib import Path

import pytest
from play_fixtures import folder, run
from policy_fixtures import cli

__all__ = ["cli", "exports", "folder", "run"]

_MADE = Path(__file__).parents[2] / ".venv-peers" / "exports"


@pytest.fixture(scope="session")
def exports():
    """The folder that `mjlab_exports.py` has filled."""
    made = Path(os.environ.get("HUMANOID_SIM_EXPORTS", _MADE))
    if not (made / "rsl_rl").is_dir():
        pytest.skip(f"no exports in {made}; `make test-peers` makes them")
    return made
