"""Programs beside the loop: each reads a session's ticks, sends intents and data, and may die at any time.

A front end is a module `humanoid_sim/<name>.py`, and a verb; its parts are here. `play` starts it as a child process,
anybody else later with `python -m humanoid_sim.<name>`; its first line says that it runs.
"""

from __future__ import annotations

import importlib.util

from humanoid_sim.errors import MissingPackageError

_EXTRAS = {
    "midi": (("rtmidi",), "a MIDI keyboard"),
    "dds": (("cyclonedds",), "the DDS bridge"),
    "rerun": (("rerun", "rerun_cli"), "rerun's viewer"),
}
"""Packages that front ends import beside those that this package always needs, by the extra, which is called alike."""


def require_packages(name: str) -> None:
    """Raise `MissingPackageError` for a front end whose packages are not installed."""
    packages, purpose = _EXTRAS.get(name, ((), ""))
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise MissingPackageError(package, name, purpose)
