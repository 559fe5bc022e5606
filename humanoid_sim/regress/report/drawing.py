"""Matplotlib figures as SVG inside a page: no display, no global state, the same bytes every time."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from humanoid_sim.regress.report.markup import attributes
from humanoid_sim.regress.report.palette import COLOURS, themed
from humanoid_sim.regress.words import displayed_unit

__all__ = ["WIDTH", "Sheet", "axis_label", "drawing", "style_axes"]

WIDTH = 11.1
"""Inches of 72 points: the page's column."""

_DPI = 72.0
"""Of SVG output: one figure inch is 72 points."""

_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: small, sharp, and found by the browser's search
    "svg.hashsalt": "humanoid_sim",  # names of clip paths, random otherwise
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with Matplotlib: the layout does not depend on the machine's fonts
    "font.size": 9.0,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "axes.edgecolor": COLOURS["grid"],
    "axes.labelcolor": COLOURS["faint"],
    "axes.titlecolor": COLOURS["ink"],
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["grid"],
    "ytick.color": COLOURS["grid"],
    "xtick.labelcolor": COLOURS["faint"],
    "ytick.labelcolor": COLOURS["faint"],
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


class Sheet:
    """A figure that is being drawn, and the SVG that becomes of it."""

    def __init__(self, height: float) -> None:
        self.figure = Figure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasSVG(self.figure)
        self.svg = ""
        """Complete once the `drawing` has ended."""


@contextmanager
def drawing(height: float, name: str, description: str) -> Iterator[Sheet]:
    """A sheet to draw on; afterwards its `svg` is ready.

    Args:
        height: inches of 72 points; the width is `WIDTH`.
        name: unique in the page: what the SVG defines must not be confused with another's.
        description: for readers who cannot see it.
    """
    with mpl.rc_context(_SETTINGS):
        sheet = Sheet(height)
        yield sheet
        buffer = io.StringIO()
        sheet.figure.savefig(buffer, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    sheet.svg = _inline(buffer.getvalue(), name, description)


def style_axes(axes: Axes, *, grid: Literal["both", "x", "y"] = "both") -> None:
    """Ticks without marks, and a grid along one axis only where the other counts nothing."""
    axes.tick_params(length=0)
    if grid != "both":
        axes.grid(visible=False)
        axes.grid(visible=True, axis=grid)


def axis_label(name: str, unit: str) -> str:
    """Such as `body position error [mm]`."""
    return f"{name.replace('_', ' ')} [{displayed_unit(unit)[1]}]"


def _inline(svg: str, name: str, description: str) -> str:
    """The `svg` element alone, as wide as its column at most, every name in it made unique."""
    element = svg[svg.index("<svg") :]
    opening, rest = element.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', opening)
    width = re.search(r'width="([\d.]+)pt"', opening)
    assert box is not None
    assert width is not None
    rest = re.sub(r"<metadata>.*?</metadata>\s*", "", rest, flags=re.DOTALL)
    rest = re.sub(r'\bid="', f'id="{name}-', rest)
    rest = rest.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
    style = f"max-width: {float(width.group(1)) * 4 / 3:.0f}px"  # a point is 4/3 of a CSS pixel
    head = f"<svg {box.group()} {attributes(role='img', style=style)} {attributes(**{'aria-label': description})}>"
    return themed(head + rest.strip())
