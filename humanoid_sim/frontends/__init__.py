"""Programs beside the loop: each reads a session's ticks, sends intents and data, and may die at any time.

A front end is a row of `humanoid_sim.cli.FRONT_ENDS` and a module `humanoid_sim/<name>.py`; its parts are here. `play`
starts it as a child process, anybody else later with `python -m humanoid_sim.<name>`; its first line says that it runs.
"""

from __future__ import annotations

import importlib.util

from humanoid_sim.cli import FRONT_ENDS
from humanoid_sim.errors import MissingPackageError


def require_packages(name: str) -> None:
    """Raise `MissingPackageError` for a front end whose packages are not installed."""
    front_end = FRONT_ENDS[name]
    for package in front_end.packages:
        if importlib.util.find_spec(package) is None:
            raise MissingPackageError(package, front_end.extra, front_end.purpose)
