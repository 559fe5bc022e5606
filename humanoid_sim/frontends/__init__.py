"""Programs beside the loop: each reads a session's feed and writes to its intake, and may die at any time.

A front end is a row of `FRONT_ENDS` and a module `humanoid_sim/<name>.py`; its parts are a package here.
`play` starts it as a child process; anybody else starts it later with `python -m humanoid_sim.<name>`.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from humanoid_sim.errors import MissingPackageError

__all__ = ["FRONT_ENDS", "FrontEnd", "Wanted", "require_packages"]


@dataclass(frozen=True, slots=True)
class FrontEnd:
    """Facts about a front end that are known without importing it."""

    purpose: str
    packages: tuple[str, ...] = ()
    """Packages that it imports, other than those that this package always needs."""
    extra: str = ""
    """Extra of this package that installs them."""


FRONT_ENDS: Mapping[str, FrontEnd] = MappingProxyType(
    {
        "console": FrontEnd("the browser console", ("viser", "mjviser", "plotly", "websockets"), "console"),
        "dds": FrontEnd("the DDS bridge", ("cyclonedds",), "dds"),
        "foxglove": FrontEnd("a server for Foxglove", ("foxglove",), "foxglove"),
        "gamepad": FrontEnd("a gamepad", ("pygame",), "gamepad"),
        "gravity": FrontEnd("gravity compensation, for REMOTE"),
        "midi": FrontEnd("a MIDI keyboard", ("rtmidi",), "midi"),
        "rerun": FrontEnd("rerun's viewer", ("rerun", "rerun_cli"), "rerun"),
        "viewer": FrontEnd("MuJoCo's window"),
    }
)
"""Front ends by name, which is also that of the module and of the verb."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A front end to start with a session."""

    name: str
    """Name in `FRONT_ENDS`."""
    options: tuple[str, ...] = ()
    """Options of its command line; `--session` is added."""
    label: str = ""
    """Label of one that runs twice; empty: its name."""


def require_packages(name: str) -> None:
    """Refuse a front end whose packages are not installed, before anything is started.

    Raises:
        MissingPackageError: naming the first.
    """
    front_end = FRONT_ENDS[name]
    for package in front_end.packages:
        if importlib.util.find_spec(package) is None:
            raise MissingPackageError(package, front_end.extra, front_end.purpose)
