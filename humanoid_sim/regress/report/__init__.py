"""Report of a regression run: one self-contained HTML page (extra `report`).

Its text is the template `page.html`; Matplotlib draws the plots as SVG inside it. The page needs no network, no script
and no other file, and the same results give the same page, to the byte.
"""

from __future__ import annotations

from importlib.util import find_spec

from humanoid_sim.errors import MissingPackageError


def require_report() -> None:
    """Ask for what the report needs, before anything has run for it.

    Raises:
        MissingPackageError: if Matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise MissingPackageError("matplotlib", "report", "--report")
