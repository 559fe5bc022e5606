"""Matplotlib figures as SVG inside a page: no display, no global state, the same bytes every time, light and dark."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from html import escape
from types import MappingProxyType
from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

COLOURS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "ink": ("#1c2733", "#e3e8ed"),
        "faint": ("#66727f", "#98a4b0"),
        "grid": ("#dfe4e9", "#313b46"),
        "paper": ("#ffffff", "#12181e"),
        "baseline": ("#7c8a99", "#8f9dab"),
        "candidate1": ("#2563b8", "#6ea8f5"),
        "candidate2": ("#b8650f", "#eda350"),
        "candidate3": ("#7a3fb0", "#bd90ea"),
        "candidate4": ("#0f7f7a", "#4fc3bd"),
        "worse": ("#c42f3d", "#f0707b"),
        "better": ("#1e8a4f", "#58c98a"),
        "unclear": ("#a87800", "#e0b34a"),
    }
)
"""Colours by meaning, in light and in dark. Colour-blind readers can tell worse from better, and candidates apart."""

LIGHT: Mapping[str, str] = MappingProxyType({meaning: light for meaning, (light, _) in COLOURS.items()})
"""Colours that plots are drawn in; on the page these colours become variables."""

COLUMNS = 3
_CANDIDATES = 4
_WIDTH = 11.1
"""Inches of 72 points: the page's column."""
_DPI = 72.0
"""Resolution of SVG output: one figure inch is 72 points."""

SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text: small, sharp, and found by the browser's search
    "svg.hashsalt": "humanoid_sim",  # names of clip paths, random otherwise
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],  # comes with Matplotlib: the layout does not depend on the machine's fonts
    "font.size": 9.0,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "axes.edgecolor": LIGHT["grid"],
    "axes.labelcolor": LIGHT["faint"],
    "axes.titlecolor": LIGHT["ink"],
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "text.color": LIGHT["ink"],
    "xtick.labelcolor": LIGHT["faint"],
    "ytick.labelcolor": LIGHT["faint"],
    "grid.color": LIGHT["grid"],
    "grid.linewidth": 0.7,
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
"""Settings of Matplotlib while a figure is made, drawn on and written."""


def candidate_colour(index: int) -> str:
    """Return the colour of the candidate at `index`; the fifth has the first one's again."""
    return LIGHT[f"candidate{index % _CANDIDATES + 1}"]


def panels(count: int, height: float, header: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Return a figure with `count` places for plots, `COLUMNS` in a row at most.

    Args:
        height: inches of 72 points, of a row.
        header: likewise, above the first one.
    """
    rows = -(-count // COLUMNS)
    figure = Figure(figsize=(_WIDTH, header + rows * height), layout="constrained")
    FigureCanvasSVG(figure)
    grid = list(figure.subplots(rows, min(count, COLUMNS), squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def style_axes(axes: Axes, *, grid: Literal["both", "x"] = "both") -> None:
    """Ticks without marks, and a grid along x alone where y counts nothing."""
    axes.tick_params(length=0)
    axes.grid(visible=True, axis=grid)


def svg_of(figure: Figure, name: str, description: str) -> str:
    """Return the `svg` element of a figure, its colours those of the page in light and dark.

    Args:
        figure: drawn under `SETTINGS`.
        name: unique in the page: what the SVG defines must not be confused with another's.
        description: for readers who cannot see it.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", dpi=_DPI, metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    opening, body = svg[svg.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="[^"]*"', opening)
    assert box is not None
    body = re.sub(r"<metadata>.*?</metadata>\s*", "", body, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{name}-', body)
    body = body.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
    for meaning, colour in LIGHT.items():
        body = body.replace(colour, f"var(--{meaning})")
    return f'<svg {box.group()} role="img" aria-label="{escape(description)}">{body.strip()}'
