"""The report of a regression run: one self-contained HTML page (extra `report`).

Its text is the template `page.html`; Matplotlib draws the plots as SVG inside it. The page needs no network, no script
and no other file, and the same results give the same page, to the byte.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

from humanoid_sim.errors import MissingPackageError
from humanoid_sim.regress.results import Results

if TYPE_CHECKING:
    from humanoid_sim.regress.report.pictures import Picture

__all__ = ["report_page", "require_report"]


def require_report() -> None:
    """Ask for what the report needs, before anything has run for it.

    Raises:
        MissingPackageError: if Matplotlib is not installed.
    """
    if find_spec("matplotlib") is None:
        raise MissingPackageError("matplotlib", "report", "--report")


def report_page(results: Results, pictures: Sequence[Sequence[Picture]] = ()) -> str:
    """Return the page, as HTML.

    Args:
        results: of the run.
        pictures: of each candidate's worst episode; none without.

    Raises:
        MissingPackageError: if Matplotlib is not installed.
    """
    require_report()
    from humanoid_sim.regress.report.page import render  # noqa: PLC0415 - Matplotlib only where there is a report

    return render(results, pictures)
